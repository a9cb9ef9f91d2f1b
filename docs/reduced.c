/* A reduced body of skfem-stvk in C or C++: steps of linearised backward Euler (eq. 9) from the file of reduced.save("bar.txt").
   cc -O2 -o reduced reduced.c -lm && ./reduced bar.txt DT STEPS ALPHA BETA SPEED LOCATION FORCE...
   Lifts move at SPEED; the total FORCE, one number per dimension, pushes on LOCATION. Its displacements are printed. All numbers
   have the units that `units` of the file names, such as m, kg, s and N. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 1000000000 };                                                             /* entries of an array, and an integer */
typedef char Text[128];
typedef struct { char name[64], type[8]; int rank; long size[5]; double *at; Text *text; } Array;          /* ids too are doubles */
static Array arrays[32];                                                                     /* the last one has an empty name */

static void *zeros(long n, size_t bytes) {
    void *made = calloc(n + 1, bytes);
    if (!made) fprintf(stderr, "there is no memory for %ld entries\n", n), exit(1);
    return made;
}

static double *reals(long n) { return (double *)zeros(n, sizeof(double)); }

/* The array of a name with this type, this number of dimensions and these sizes, of which -1 may be any. */
static Array *find(const char *name, const char *type, int rank, long n0, long n1, long n2) {
    const long size[] = {n0, n1, n2};
    for (Array *a = arrays; *a->name; a++) {
        int same = !strcmp(a->name, name) && !strcmp(a->type, type) && a->rank == rank;
        for (int r = 0; same && r < rank; r++) same = size[r] < 0 || size[r] == a->size[r];
        if (same) return a;
    }
    fprintf(stderr, "there is no array %s of type %s and its sizes: is this the text of a reduced body?\n", name, type);
    exit(1);
}

static int read_array(FILE *in, Array *a) {
    int text = !strcmp(a->type, "text"), whole = !strcmp(a->type, "int"), good = text || whole || !strcmp(a->type, "real");
    long n = 1;
    good &= a->rank >= 1 && a->rank <= (text ? 1 : 5);
    for (int r = 0; good && r < a->rank; r++) {
        good = fscanf(in, "%ld", &a->size[r]) == 1 && a->size[r] >= 0 && a->size[r] <= MOST / (n > 0 ? n : 1);
        n *= a->size[r];
    }
    if (!good) return 0;
    if (text) a->text = (Text *)zeros(n, sizeof(Text));
    else a->at = reals(n);
    for (long i = 0; good && i < n; i++) {
        good = (text ? fscanf(in, " %127[^\n]", a->text[i]) : fscanf(in, "%lf", &a->at[i])) == 1;
        if (whole) good &= fabs(a->at[i]) <= MOST && floor(a->at[i]) == a->at[i];
    }
    return good;
}

static int read_arrays(const char *path) {
    FILE *in = fopen(path, "r");
    int version = 0, good = in && fscanf(in, "skfem-stvk reduced body %d", &version) == 1 && version == 1;
    for (Array *a = arrays; good && fscanf(in, "%63s %7s %d", a->name, a->type, &a->rank) == 3; a++)
        good = a < arrays + 31 && read_array(in, a);
    good = good && feof(in);
    if (in) fclose(in);
    return good;
}

/* dW/dx (n) and d2W/dx2 (n, n) of W = sum of T_abcd x_a x_b x_c x_d over a <= b <= c <= d, with x_0 = 1: the last index, d, runs
   slowest in T. A row of T belongs to one d and one c and has all pairs a <= b <= c, of which the pair a, b is b (b + 1)/2 + a. */
static void quartic(long n, const double *T, const double *x, double *gradient, double *H) {
    long pairs = n * (n + 1) / 2;
    double *p = reals(pairs), *P = reals(pairs), *Y = reals(n * pairs);
    for (long b = 0; b < n; b++) for (long a = 0; a <= b; a++) p[b * (b + 1) / 2 + a] = x[a] * x[b];
    for (long d = 0; d < n; d++) for (long c = 0; c <= d; c++) {
        long row = (c + 1) * (c + 2) / 2;
        double total = 0, *Yc = Y + c * pairs, *Yd = Y + d * pairs;
        for (long i = 0; i < row; i++) total += T[i] * p[i], Yc[i] += x[d] * T[i], Yd[i] += x[c] * T[i];
        P[d * (d + 1) / 2 + c] += total;
        T += row;
    }
    for (long e = 0; e < n; e++) {
        double *own = P + e * (e + 1) / 2, *Ye = Y + e * pairs;
        for (long i = 0; i < (e + 1) * (e + 2) / 2; i++) P[i] += x[e] / 2 * Ye[i];
        for (long b = 0; b <= e; b++) {
            double total = 0, *y = Ye + b * (b + 1) / 2;
            for (long a = 0; a <= b; a++) total += x[a] * y[a], own[a] += x[b] * y[a];
            own[b] += total;
        }
    }
    for (long b = 0; b < n; b++) for (long a = 0; a <= b; a++)
        H[a * n + b] = H[b * n + a] = (a == b ? 2 : 1) * P[b * (b + 1) / 2 + a];
    for (long a = 0; a < n; a++) {
        gradient[a] = 0;
        for (long b = 0; b < n; b++) gradient[a] += H[a * n + b] * x[b] / 3;
    }
    free(p), free(P), free(Y);
}

/* Solve A y = b by Cholesky, A (r, r) symmetric and positive definite with rows of n entries; A is overwritten, b becomes y. */
static int solve(long r, long n, double *A, double *b) {
    for (long i = 0; i < r; i++) for (long j = 0; j <= i; j++) {
        double sum = A[i * n + j];
        for (long k = 0; k < j; k++) sum -= A[i * n + k] * A[j * n + k];
        if (i == j && !(sum > 0)) return 0;
        A[i * n + j] = i == j ? sqrt(sum) : sum / A[j * n + j];
    }
    for (long i = 0; i < r; b[i] /= A[i * n + i], i++) for (long k = 0; k < i; k++) b[i] -= A[i * n + k] * b[k];
    for (long i = r; i-- > 0; b[i] /= A[i * n + i]) for (long k = i + 1; k < r; k++) b[i] -= A[k * n + i] * b[k];
    return 1;
}

/* One step: (M/h^2 + D/h + K) w = M v/h + force - F(z) over the r unknowns, D = alpha M + beta K(0). The l entries of w after them
   are given: how far the lifts move. Then z <- z + w, v <- w/h. */
static int step(double h, double alpha, double beta, const double *force, double *w, double *z, double *v) {
    const double *size = find("size", "int", 1, 2, -1, -1)->at;
    long r = size[0], m = r + size[1], n = m + 1;
    const double *M = find("mass", "real", 2, m, m, -1)->at, *K0 = find("stiffness", "real", 2, m, m, -1)->at;
    const double *T = find("T", "real", 1, n * (n + 1) * (n + 2) / 6 * (n + 3) / 4, -1, -1)->at;
    double *x = reals(n), *G = reals(n), *H = reals(n * n), *A = reals(m * m);
    x[0] = 1, memcpy(x + 1, z, m * sizeof *x);
    quartic(n, T, x, G, H);
    for (long i = 0; i < r; i++) {
        w[i] = force[i] - G[i + 1];
        for (long j = 0; j < m; j++) {
            A[i * m + j] = (1 / h + alpha) / h * M[i * m + j] + beta / h * K0[i * m + j] + H[(i + 1) * n + j + 1];
            w[i] += M[i * m + j] * v[j] / h;
        }
        for (long j = r; j < m; j++) w[i] -= A[i * m + j] * w[j];
    }
    int solved = solve(r, m, A, w);
    for (long i = 0; solved && i < m; i++) z[i] += w[i], v[i] = w[i] / h;
    free(x), free(G), free(H), free(A);
    return solved;
}

int main(int argc, char **argv) {
    if (argc < 9) return fprintf(stderr, "usage: reduced BODY.txt DT STEPS ALPHA BETA SPEED LOCATION FORCE...\n"), 1;
    if (!read_arrays(argv[1])) return fprintf(stderr, "%s is not whole, or no text of skfem-stvk reduced body 1\n", argv[1]), 1;
    double h = atof(argv[2]), alpha = atof(argv[4]), beta = atof(argv[5]), speed = atof(argv[6]);
    const double *size = find("size", "int", 1, 2, -1, -1)->at;
    Array *locations = find("locations", "text", 1, -1, -1, -1);
    long r = size[0], l = size[1], m = r + l, count = locations->size[0], at = 0;
    if (r < 0 || l < 0) return fprintf(stderr, "size = %ld %ld; expected numbers of unknowns and lifts\n", r, l), 1;
    Array *nodes = find("rows", "real", 3, -1, -1, m);
    const double *rows = nodes->at, *starts = find("starts", "int", 1, count + 1, -1, -1)->at;
    long d = nodes->size[1];
    while (at < count && strcmp(locations->text[at], argv[7])) at++;
    if (at == count || argc != 8 + d) return fprintf(stderr, "no location %s, or not %ld forces\n", argv[7], d), 1;
    long first = starts[at], last = starts[at + 1];
    if (first < 0 || last < first || last > nodes->size[0]) return fprintf(stderr, "starts: expected rows of nodes\n"), 1;
    double *z = reals(m), *v = reals(m), *w = reals(m), *force = reals(m);
    memcpy(z + r, find("amounts", "real", 1, l, -1, -1)->at, l * sizeof *z);
    memcpy(force, find("loads", "real", 1, m, -1, -1)->at, m * sizeof *force);
    for (long node = first; node < last; node++) for (long c = 0; c < d; c++) for (long j = 0; j < m; j++)
        force[j] += rows[(node * d + c) * m + j] * atof(argv[8 + c]) / (last - first);      /* equal parts on the nodes */
    for (long i = 0; i < atol(argv[3]); i++) {
        for (long j = r; j < m; j++) w[j] = speed * h;
        if (!step(h, alpha, beta, force, w, z, v)) return fprintf(stderr, "step %ld: K is not positive definite\n", i), 1;
    }
    for (long node = first; node < last; node++) for (long c = 0; c < d; c++) {
        double u = 0;
        for (long j = 0; j < m; j++) u += rows[(node * d + c) * m + j] * z[j];
        printf("%.17g%c", u, c + 1 < d ? ' ' : '\n');
    }
    return 0;
}
