/* Test vectors of skfem-stvk in C: W, F and K in every state from edges and pairs of edges alone.
   cc -O2 -o vectors vectors.c && ./vectors vectors.txt results.txt && skfem-stvk verify --results . */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct { char name[64], type[8], text[128]; int rank; long size[5]; double *at; } Array; /* ids too: doubles hold them */
static Array arrays[64];

static Array *find(const char *name) {
    for (Array *a = arrays; *a->name; a++) if (!strcmp(a->name, name)) return a;
    fprintf(stderr, "there is no %s: are these vectors of linear simplices?\n", name);
    exit(1);
}

static void print(FILE *out, const char *name, int rank, long rows, long columns, const double *at) {
    fprintf(out, "%s real %d %ld", name, rank, rows);
    fprintf(out, rank > 1 ? " %ld\n" : "\n", columns);
    for (long i = 0; i < rows * columns; i++) fprintf(out, "%.17g\n", at[i]);
}

int main(int argc, char **argv) {
    FILE *in = argc == 3 ? fopen(argv[1], "r") : NULL, *out = in ? fopen(argv[2], "w") : NULL;
    int good = out && fscanf(in, "skfem-stvk vectors %*d") != EOF;
    for (Array *a = arrays; good && fscanf(in, "%63s %7s %d", a->name, a->type, &a->rank) == 3; a++) {
        long n = 1, i = 0;
        for (int r = 0; r < a->rank; r++) good &= fscanf(in, "%ld", &a->size[r]) == 1, n *= a->size[r];
        a->at = malloc((n + 1) * sizeof(double));
        int text = !strcmp(a->type, "text");
        for (; i < n && good; i++) good = (text ? fscanf(in, " %127[^\n]", a->text) : fscanf(in, "%lf", &a->at[i])) == 1;
    }
    if (!out) return fprintf(stderr, "usage: vectors VECTORS.txt RESULTS.txt; one that can be read, one that can be written\n"), 1;
    if (!good) return fprintf(stderr, "%s is not whole, or no text of skfem-stvk vectors 1\n", argv[1]), 1;
    double *X = find("nodes")->at, *u = find("u")->at, *ends = find("edges")->at, *pair = find("pairs")->at;
    double *own = find("edge_coefficients")->at, *between = find("pair_coefficients")->at;
    double *starts = find("K_row_starts")->at, *columns = find("K_columns")->at;
    long ns = find("u")->size[0], n = find("u")->size[1], d = find("nodes")->size[1], nnz = find("K_columns")->size[0];
    long ne = find("edges")->size[0], np = find("pairs")->size[0];
    double *W = calloc(ns, 8), *F = calloc(ns * n, 8), *values = calloc(ns * nnz, 8), *K = malloc(n * n * 8);
    double *p = malloc(ne * d * 8), *zeta = malloc(ne * 8), *t = malloc(ne * 8);
    for (long s = 0; s < ns; s++, u += n) {
        memset(K, 0, n * n * 8);
        for (long e = 0; e < ne; e++) {                            /* zeta = |p|^2 - |P|^2, without cancellation */
            zeta[e] = 0;
            for (long x = 0, a = d * ends[2 * e], b = d * ends[2 * e + 1]; x < d; x++) {
                double P = X[a + x] - X[b + x], U = u[a + x] - u[b + x];
                p[e * d + x] = P + U, zeta[e] += (P + P + U) * U;
            }
            t[e] = own[e] * zeta[e];
        }
        for (long q = 0; q < 2 * np; q++)                          /* t_i = sum_j L_ij zeta_j */
            t[(long)pair[q]] += between[q / 2] * zeta[(long)pair[q ^ 1]];
        for (long e = 0; e < ne; e++) {
            W[s] += t[e] * zeta[e] / 4;
            for (int a = 0; a < 2; a++) for (long x = 0, row = d * ends[2 * e + a]; x < d; x++) {
                F[s * n + row + x] += (a ? -t[e] : t[e]) * p[e * d + x];
                for (int b = 0; b < 2; b++) K[(row + x) * n + d * (long)ends[2 * e + b] + x] += a == b ? t[e] : -t[e];
            }
        }
        for (long q = -ne; q < 2 * np; q++) {                      /* 2 L_ij p_i p_j', of edges alone and of pairs both ways */
            long i = q < 0 ? q + ne : pair[q], j = q < 0 ? i : pair[q ^ 1];
            double L = 2 * (q < 0 ? own[i] : between[q / 2]);
            for (int c = 0; c < 4; c++) for (long x = 0; x < d; x++) for (long y = 0; y < d; y++)
                K[(d * (long)ends[2 * i + c / 2] + x) * n + d * (long)ends[2 * j + c % 2] + y] +=
                    (c == 0 || c == 3 ? L : -L) * p[i * d + x] * p[j * d + y];
        }
        for (long row = 0; row < n; row++)
            for (long k = starts[row]; k < starts[row + 1]; k++) values[s * nnz + k] = K[row * n + (long)columns[k]];
    }
    fprintf(out, "skfem-stvk vectors 1\ndigest text 1 1\n%s\nprogram text 1 1\nvectors.c\n", find("digest")->text);
    print(out, "W", 1, ns, 1, W);
    print(out, "F", 2, ns, n, F);
    print(out, "K_values", 2, ns, nnz, values);
    return fclose(out) != 0;
}
