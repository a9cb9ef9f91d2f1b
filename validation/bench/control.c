/* Plain loop over P1 tetrahedra for St. Venant-Kirchhoff's law in the Total Lagrangian form, the reference for the speed of the
   assembly from edges. C = F'F, S = lambda tr(E) I + 2 mu E, P = F S. Forces and 3x3 blocks are added in the order of the mesh.

   rest     (nv, 3) vertices
   corner   (nt, 4) vertices of each tetrahedron
   grad     (nt, 3, 3) gradients of the barycentric coordinates 1, 2, 3; the gradient of coordinate 0 is minus their sum
   lam, mu  (nt,) Lame's constants times the volume
   block_of (nt, 4, 4) index of the block of K to which each pair of corners contributes */

#include <string.h>

enum { X, Y, Z };

struct state {
  double F[3][3];              /* F[i][J] = dx_i / dX_J */
  double xx, yy, zz, xy, yz, zx; /* E */
};

static inline double dot(const double a[3], const double b[3]) { return a[X] * b[X] + a[Y] * b[Y] + a[Z] * b[Z]; }

static inline struct state deform(const double *x, const int c[4], const double g[9]) {
  struct state s;
  for (int i = 0; i < 3; i++) {
    double x0 = x[3 * c[0] + i];
    double a = x[3 * c[1] + i] - x0, b = x[3 * c[2] + i] - x0, d = x[3 * c[3] + i] - x0;
    for (int J = 0; J < 3; J++) s.F[i][J] = a * g[J] + b * g[3 + J] + d * g[6 + J];
  }
#define RIGHT_CAUCHY(I, J) (s.F[X][I] * s.F[X][J] + s.F[Y][I] * s.F[Y][J] + s.F[Z][I] * s.F[Z][J])
  s.xx = 0.5 * (RIGHT_CAUCHY(X, X) - 1);
  s.yy = 0.5 * (RIGHT_CAUCHY(Y, Y) - 1);
  s.zz = 0.5 * (RIGHT_CAUCHY(Z, Z) - 1);
  s.xy = 0.5 * RIGHT_CAUCHY(X, Y);
  s.yz = 0.5 * RIGHT_CAUCHY(Y, Z);
  s.zx = 0.5 * RIGHT_CAUCHY(Z, X);
  return s;
}

/* S times the volume */
static inline void stress(const struct state *s, double lam, double mu, double S[3][3]) {
  double pressure = lam * (s->xx + s->yy + s->zz), twice = 2 * mu;
  S[X][X] = pressure + twice * s->xx;
  S[Y][Y] = pressure + twice * s->yy;
  S[Z][Z] = pressure + twice * s->zz;
  S[X][Y] = S[Y][X] = twice * s->xy;
  S[Y][Z] = S[Z][Y] = twice * s->yz;
  S[Z][X] = S[X][Z] = twice * s->zx;
}

double energy(long nt, const double *x, const int *corner, const double *grad, const double *lam, const double *mu) {
  double total = 0;
  for (long e = 0; e < nt; e++) {
    struct state s = deform(x, corner + 4 * e, grad + 9 * e);
    double trace = s.xx + s.yy + s.zz;
    double square = s.xx * s.xx + s.yy * s.yy + s.zz * s.zz + 2 * (s.xy * s.xy + s.yz * s.yz + s.zx * s.zx);
    total += 0.5 * lam[e] * trace * trace + mu[e] * square;
  }
  return total;
}

void force(long nt, long nv, const double *x, const int *corner, const double *grad, const double *lam, const double *mu,
           double *restrict f) {
  memset(f, 0, 3 * nv * sizeof *f);
  for (long e = 0; e < nt; e++) {
    const int *c = corner + 4 * e;
    const double *g = grad + 9 * e;
    struct state s = deform(x, c, g);
    double S[3][3];
    stress(&s, lam[e], mu[e], S);
    double P[3][3], h[3][3]; /* compute all of h before writing to f: alternating costs a third more time in large meshes */
    for (int i = 0; i < 3; i++)
      for (int J = 0; J < 3; J++) P[i][J] = dot(s.F[i], S[J]);
    for (int a = 0; a < 3; a++)
      for (int i = 0; i < 3; i++) h[a][i] = dot(P[i], g + 3 * a);
    for (int i = 0; i < 3; i++) {
      f[3 * c[1] + i] += h[0][i];
      f[3 * c[2] + i] += h[1][i];
      f[3 * c[3] + i] += h[2][i];
      f[3 * c[0] + i] -= h[0][i] + h[1][i] + h[2][i];
    }
  }
}

/* Block (a, b): V [lambda (F g_a)(F g_b)' + mu (F g_b)(F g_a)' + mu (g_a.g_b) F F' + (g_a.S g_b) I] */
void tangent(long nt, long nb, const double *x, const int *corner, const double *grad, const int *block_of, const double *lam,
             const double *mu, double *restrict K) {
  memset(K, 0, 9 * nb * sizeof *K);
  for (long e = 0; e < nt; e++) {
    struct state s = deform(x, corner + 4 * e, grad + 9 * e);
    double l = lam[e], m = mu[e], S[3][3], left[3][3], g[4][3], Fg[4][3], Sg[4][3];
    stress(&s, l, m, S);
    memcpy(g[1], grad + 9 * e, 9 * sizeof(double));
    for (int J = 0; J < 3; J++) g[0][J] = -(g[1][J] + g[2][J] + g[3][J]);
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++) left[i][k] = dot(s.F[i], s.F[k]);
    for (int a = 0; a < 4; a++)
      for (int i = 0; i < 3; i++) {
        Fg[a][i] = dot(s.F[i], g[a]);
        Sg[a][i] = dot(S[i], g[a]);
      }
    for (int a = 0; a < 4; a++)
      for (int b = 0; b < 4; b++) {
        double *block = K + 9L * block_of[16 * e + 4 * a + b];
        double shear = m * dot(g[a], g[b]), geometric = dot(Sg[a], g[b]);
        for (int i = 0; i < 3; i++)
          for (int k = 0; k < 3; k++) block[3 * i + k] += l * Fg[a][i] * Fg[b][k] + m * Fg[b][i] * Fg[a][k] + shear * left[i][k];
        for (int i = 0; i < 3; i++) block[4 * i] += geometric;
      }
  }
}
