/* St. Venant-Kirchhoff tetrahedra from deformation gradients: a library for `skfem-stvk verify --library`.
   cc -O2 -shared -fPIC -o libmine.so stvk.c                 -DFAULT doubles lambda, which the report names */
#include "candidate.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TOO_LITTLE_MEMORY = 1, NO_TETRAHEDRA = 2 };

typedef struct { int64_t nodes[4]; double g[4][3], volume, lambda, mu; } Element; /* g: gradients of the shape functions [1/m] */
static Element *elements;
static int64_t nv, nt, *rows, *columns;
static double *values;

static void cross(const double *a, const double *b, double *c) {
    for (int i = 0; i < 3; i++) c[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

int mine_body(int64_t node_count, int32_t d, const double *nodes, int64_t count, int32_t n, const int64_t *ids,
              const double *young, const double *poisson) {
    if (d != 3 || n != 4) return NO_TETRAHEDRA;
    free(elements), free(rows), free(columns), free(values);
    nv = node_count, nt = count;
    elements = malloc(nt * sizeof *elements);
    rows = malloc(144 * nt * sizeof *rows), columns = malloc(144 * nt * sizeof *columns), values = malloc(144 * nt * sizeof *values);
    if (!elements || !rows || !columns || !values) return TOO_LITTLE_MEMORY;
    for (int64_t t = 0; t < nt; t++) {
        Element *e = &elements[t];
        double D[3][3];                                               /* edges from the first node */
        memcpy(e->nodes, ids + 4 * t, sizeof e->nodes);
        for (int a = 0; a < 3; a++) for (int i = 0; i < 3; i++) D[a][i] = nodes[3 * e->nodes[a + 1] + i] - nodes[3 * e->nodes[0] + i];
        for (int a = 0; a < 3; a++) cross(D[(a + 1) % 3], D[(a + 2) % 3], e->g[a + 1]);
        double det = dot(D[0], e->g[1]);
        e->volume = fabs(det) / 6;
        for (int i = 0; i < 3; i++) {
            for (int a = 1; a < 4; a++) e->g[a][i] /= det;
            e->g[0][i] = -(e->g[1][i] + e->g[2][i] + e->g[3][i]);
        }
        e->mu = young[t] / (2 * (1 + poisson[t]));
        e->lambda = 2 * e->mu * poisson[t] / (1 - 2 * poisson[t]);
#ifdef FAULT
        e->lambda *= 2;
#endif
    }
    return 0;
}

/* f = I + H, S = lambda tr(E) I + 2 mu E, and the energy per volume; E = (H + H' + H'H)/2 keeps the digits of small strains */
static double state(const Element *e, const double *u, double f[3][3], double S[3][3]) {
    double H[3][3] = {{0}}, E[3][3], trace = 0, density = 0;
    for (int a = 0; a < 4; a++) for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) H[i][j] += u[3 * e->nodes[a] + i] * e->g[a][j];
    for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) {
        E[i][j] = (H[i][j] + H[j][i] + H[0][i] * H[0][j] + H[1][i] * H[1][j] + H[2][i] * H[2][j]) / 2;
        f[i][j] = (i == j) + H[i][j];
    }
    for (int i = 0; i < 3; i++) trace += E[i][i];
    for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) {
        S[i][j] = 2 * e->mu * E[i][j] + (i == j ? e->lambda * trace : 0);
        density += S[i][j] * E[i][j] / 2;
    }
    return density;
}

static void product(double A[3][3], const double *x, double *y) { for (int i = 0; i < 3; i++) y[i] = dot(A[i], x); }

int mine_W(const double *u, double *W) {
    double f[3][3], S[3][3];
    *W = 0;
    for (int64_t t = 0; t < nt; t++) *W += elements[t].volume * state(&elements[t], u, f, S);
    return 0;
}

int mine_F(const double *u, double *F) {
    double f[3][3], S[3][3], Sg[3], P[3];
    memset(F, 0, 3 * nv * sizeof *F);
    for (int64_t t = 0; t < nt; t++) {
        const Element *e = &elements[t];
        state(e, u, f, S);
        for (int a = 0; a < 4; a++) {
            product(S, e->g[a], Sg), product(f, Sg, P);
            for (int i = 0; i < 3; i++) F[3 * e->nodes[a] + i] += e->volume * P[i];
        }
    }
    return 0;
}

int mine_K(const double *u, int64_t *count, const int64_t **r, const int64_t **c, const double **v) {
    double f[3][3], S[3][3], fg[4][3], Sg[3];
    int64_t k = 0;
    for (int64_t t = 0; t < nt; t++) {
        const Element *e = &elements[t];
        state(e, u, f, S);
        for (int a = 0; a < 4; a++) product(f, e->g[a], fg[a]);
        for (int a = 0; a < 4; a++) for (int b = 0; b < 4; b++) {
            product(S, e->g[b], Sg);
            for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++, k++) {
                rows[k] = 3 * e->nodes[a] + i, columns[k] = 3 * e->nodes[b] + j;
                values[k] = e->volume * ((i == j ? dot(e->g[a], Sg) : 0) + e->lambda * fg[a][i] * fg[b][j]
                                         + e->mu * (dot(e->g[a], e->g[b]) * dot(f[i], f[j]) + fg[b][i] * fg[a][j]));
            }
        }
    }
    *count = k, *r = rows, *c = columns, *v = values;
    return 0;
}

int mine_Kv(const double *u, const double *v, double *Kv) {
    int64_t count;
    const int64_t *r, *c;
    const double *K;
    mine_K(u, &count, &r, &c, &K);
    memset(Kv, 0, 3 * nv * sizeof *Kv);
    for (int64_t k = 0; k < count; k++) Kv[r[k]] += K[k] * v[c[k]];
    return 0;
}
