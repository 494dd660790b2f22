/* Small dense linear algebra in double precision: Cholesky of the Hessian, composition of warps. */
#ifndef BSCD_LINEAR_H
#define BSCD_LINEAR_H

#include <math.h>
#include <string.h>

#define BSCD_MOST 12 /* parameters of the second-order shape function */

/* Without square roots: a = L D L^T of a symmetric n x n matrix's lower half. l gets L below its diagonal, whose own
 * elements are 1, and 1 / D on it. 0 when a is not positive definite (a pivot below 1e-9 of its diagonal counts as
 * zero). */
static inline __attribute__((always_inline)) int cholesky(const int n, double a[BSCD_MOST][BSCD_MOST],
                                                          double l[BSCD_MOST][BSCD_MOST])
{
    for (int i = 0; i < n; i++) {
        double row[BSCD_MOST], pivot = a[i][i]; /* row: of L D */
        for (int j = 0; j < i; j++) {
            double s = a[i][j];
            for (int k = 0; k < j; k++) s -= row[k] * l[j][k];
            row[j] = s;
            l[i][j] = s * l[j][j];
            pivot -= s * l[i][j];
        }
        if (!(pivot > 1e-9 * a[i][i])) return 0;
        l[i][i] = 1 / pivot;
    }
    return 1;
}

static inline __attribute__((always_inline)) void cholesky_solve(const int n, double l[BSCD_MOST][BSCD_MOST],
                                                                 const double *b, double *x)
{
    for (int i = 0; i < n; i++) {
        double s = b[i];
        for (int k = 0; k < i; k++) s -= l[i][k] * x[k];
        x[i] = s;
    }
    for (int i = n - 1; i >= 0; i--) {
        double s = x[i] * l[i][i];
        for (int k = i + 1; k < n; k++) s -= l[k][i] * x[k];
        x[i] = s;
    }
}

/* p becomes W(p) o W(d)^-1 (Baker and Matthews 2004, eq. 34), affine: u, ux, uy, v, vx, vy. */
static inline __attribute__((always_inline)) int compose_affine(double *p, const double *d)
{
    const double a = 1 + d[1], b = d[2], c = d[4], e = 1 + d[5], det = a * e - b * c;
    if (!(fabs(det) > 1e-6)) return 0;
    const double i11 = e / det, i12 = -b / det, i21 = -c / det, i22 = a / det;
    const double iu = -(i11 * d[0] + i12 * d[3]), iv = -(i21 * d[0] + i22 * d[3]);
    const double q11 = 1 + p[1], q12 = p[2], q21 = p[4], q22 = 1 + p[5];
    p[0] += q11 * iu + q12 * iv;
    p[3] += q21 * iu + q22 * iv;
    p[1] = q11 * i11 + q12 * i21 - 1;
    p[2] = q11 * i12 + q12 * i22;
    p[4] = q21 * i11 + q22 * i21;
    p[5] = q21 * i12 + q22 * i22 - 1;
    return 1;
}

/* p becomes W(p) o W(d)^-1 for a second-order p and an affine d (of which the places of p), but its second derivatives,
 * which are held, stay as they are. */
static inline __attribute__((always_inline)) int compose_held(double *p, const double *d)
{
    const double a = 1 + d[1], b = d[2], c = d[7], e = 1 + d[8], det = a * e - b * c;
    if (!(fabs(det) > 1e-6)) return 0;
    const double i11 = e / det, i12 = -b / det, i21 = -c / det, i22 = a / det;
    const double x = -(i11 * d[0] + i12 * d[6]), y = -(i21 * d[0] + i22 * d[6]); /* where the point comes from */
    for (int side = 0; side < 2; side++) {
        double *q = p + 6 * side;
        const double bent_x = q[3] * x + q[4] * y, bent_y = q[4] * x + q[5] * y;
        const double own_x = side == 0, own_y = side == 1;
        const double to_x = own_x + q[1] + bent_x, to_y = own_y + q[2] + bent_y;
        q[0] += (to_x - bent_x / 2) * x + (to_y - bent_y / 2) * y;
        q[1] = to_x * i11 + to_y * i21 - own_x;
        q[2] = to_x * i12 + to_y * i22 - own_y;
    }
    return 1;
}

/* How (x^2, xy, y^2, x, y, 1) maps under a second-order warp, terms above the second order dropped
 * (Gao et al. 2015, Opt Lasers Eng 65:73-80, eq. 14). */
static void warp_matrix(const double *p, double w[6][6])
{
    /* x' = a . (x^2, xy, y^2, x, y, 1), y' = b . (...) */
    const double a[6] = {p[3] / 2, p[4], p[5] / 2, 1 + p[1], p[2], p[0]};
    const double b[6] = {p[9] / 2, p[10], p[11] / 2, p[7], 1 + p[8], p[6]};
    const double *left[3] = {a, a, b}, *right[3] = {a, b, b};
    for (int row = 0; row < 3; row++) {
        const double *f = left[row], *g = right[row];
        w[row][0] = f[3] * g[3] + f[0] * g[5] + f[5] * g[0];
        w[row][1] = f[3] * g[4] + f[4] * g[3] + f[1] * g[5] + f[5] * g[1];
        w[row][2] = f[4] * g[4] + f[2] * g[5] + f[5] * g[2];
        w[row][3] = f[3] * g[5] + f[5] * g[3];
        w[row][4] = f[4] * g[5] + f[5] * g[4];
        w[row][5] = f[5] * g[5];
    }
    memcpy(w[3], a, sizeof a);
    memcpy(w[4], b, sizeof b);
    memset(w[5], 0, sizeof w[5]);
    w[5][5] = 1;
}

/* p becomes W(p) W(d)^-1, second order: u, ux, uy, uxx, uxy, uyy, v, vx, ... */
static int compose_quadratic(double *p, const double *d)
{
    double w[6][6], m[6][6], row[2][6];
    warp_matrix(p, w);
    warp_matrix(d, m);
    memcpy(row[0], w[3], sizeof row[0]);
    memcpy(row[1], w[4], sizeof row[1]);
    /* rows of W(p) times M^-1: solve X M = R by elimination on the columns of M, with pivoting */
    for (int k = 0; k < 6; k++) {
        int best = k;
        for (int j = k + 1; j < 6; j++)
            if (fabs(m[k][j]) > fabs(m[k][best])) best = j;
        if (!(fabs(m[k][best]) > 1e-9)) return 0;
        if (best != k) {
            for (int i = 0; i < 6; i++) {
                const double t = m[i][k];
                m[i][k] = m[i][best];
                m[i][best] = t;
            }
            for (int i = 0; i < 2; i++) {
                const double t = row[i][k];
                row[i][k] = row[i][best];
                row[i][best] = t;
            }
        }
        for (int j = k + 1; j < 6; j++) {
            const double f = m[k][j] / m[k][k];
            for (int i = k; i < 6; i++) m[i][j] -= f * m[i][k];
            for (int i = 0; i < 2; i++) row[i][j] -= f * row[i][k];
        }
    }
    for (int i = 0; i < 2; i++)
        for (int k = 5; k >= 0; k--) {
            double s = row[i][k];
            for (int j = k + 1; j < 6; j++) s -= row[i][j] * m[j][k];
            row[i][k] = s / m[k][k];
        }
    const double *a = row[0], *b = row[1];
    p[0] = a[5];
    p[1] = a[3] - 1;
    p[2] = a[4];
    p[3] = 2 * a[0];
    p[4] = a[1];
    p[5] = 2 * a[2];
    p[6] = b[5];
    p[7] = b[3];
    p[8] = b[4] - 1;
    p[9] = 2 * b[0];
    p[10] = b[1];
    p[11] = 2 * b[2];
    return 1;
}

#endif
