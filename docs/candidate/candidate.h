/* Functions of a shared library that `skfem-stvk verify --library` calls. Copy this file, replace `mine` in the names, and leave out
   what you do not have: one of mine_W, mine_F, mine_K and mine_Kv is enough.

   Arrays are C-contiguous: the last index runs fastest. Node and element ids begin at 0. The caller owns all arrays, except those of
   mine_K. Every entry of an output must be written; outputs are not zero before the call. The arrays of mine_body stay valid until
   the next mine_body. Return 0 for success; the report shows any other number with the function and the state. */
#ifndef CANDIDATE_H
#define CANDIDATE_H
#include <stdint.h>

#ifdef _WIN32
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* The mesh: nodes (nv, d) [m]; elements (nt, n) in scikit-fem's local order, of either orientation; Young's modulus [Pa] and Poisson's
   ratio of each element (nt,). Called before the others, and again for each body. */
EXPORTED int mine_body(int64_t nv, int32_t d, const double *nodes, int64_t nt, int32_t n, const int64_t *elements,
                       const double *young, const double *poisson);

/* Strain energy W [J], one number, for the displacements u (nv, d) [m]. */
EXPORTED int mine_W(const double *u, double *W);

/* Internal force F = dW/du (nv, d) [N]. */
EXPORTED int mine_F(const double *u, double *F);

/* Tangent stiffness K = dF/du [N/m] as `count` triplets over the index d * node + component. Duplicates are added up. The arrays are
   the library's own and stay valid until its next call. */
EXPORTED int mine_K(const double *u, int64_t *count, const int64_t **rows, const int64_t **columns, const double **values);

/* Product of K with a vector v (nv, d), Kv (nv, d), for codes without a matrix. */
EXPORTED int mine_Kv(const double *u, const double *v, double *Kv);

#ifdef __cplusplus
}
#endif
#endif
