/* Routines that Abaqus offers to a UMAT, for laws that call them: cc -shared -fPIC -O2 -o law.so law.o umat_utilities.c
   Arrays and numbers are those of Fortran; tensors stand in the order 11 22 33 12 13 23. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* End the run, on all ranks: a signal ends what the launcher started. */
void xit_(void)
{
    fputs("the law called XIT\n", stderr);
    abort();
}

static void fill(double full[3][3], const double *s, int ndi, int nshr, double shear)
{
    static const int pairs[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            full[i][j] = i == j && i < ndi ? s[i] : 0.0;
    for (int k = 0; k < nshr; k++)
        full[pairs[k][0]][pairs[k][1]] = full[pairs[k][1]][pairs[k][0]] = shear * s[ndi + k];
}

/* sprime = R s R^T; lstr 1: stress, 2: strain with engineering shear. R in Fortran's order of columns. */
void rotsig_(const double *s, const double *r, double *sprime, const int *lstr, const int *ndi, const int *nshr)
{
    static const int pairs[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    double full[3][3], turned[3][3], factor = *lstr == 2 ? 0.5 : 1.0;
    fill(full, s, *ndi, *nshr, factor);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            turned[i][j] = 0.0;
            for (int k = 0; k < 3; k++)
                for (int l = 0; l < 3; l++)
                    turned[i][j] += r[i + 3 * k] * full[k][l] * r[j + 3 * l];
        }
    for (int i = 0; i < *ndi; i++)
        sprime[i] = turned[i][i];
    for (int k = 0; k < *nshr; k++)
        sprime[*ndi + k] = turned[pairs[k][0]][pairs[k][1]] / factor;
}

/* Mean sinv1 and Mises' equivalent sinv2 of a stress. */
void sinv_(const double *s, double *sinv1, double *sinv2, const int *ndi, const int *nshr)
{
    double square = 0.0, mean = 0.0, full[3][3];
    fill(full, s, *ndi, *nshr, 1.0);
    mean = (full[0][0] + full[1][1] + full[2][2]) / 3.0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double d = full[i][j] - (i == j ? mean : 0.0);
            square += d * d;
        }
    *sinv1 = mean;
    *sinv2 = sqrt(1.5 * square);
}

/* Principal values ps[3] and directions an[3][3], an(k,:) the k-th, by Jacobi's turns; lstr as in ROTSIG. */
void sprind_(const double *s, double *ps, double *an, const int *lstr, const int *ndi, const int *nshr)
{
    double a[3][3], v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    fill(a, s, *ndi, *nshr, *lstr == 2 ? 0.5 : 1.0);
    for (int turn = 0; turn < 60; turn++) {
        int i = turn % 3, j = (turn + 1) % 3;
        double angle = 0.5 * atan2(2.0 * a[i][j], a[j][j] - a[i][i]), c = cos(angle), t = sin(angle);
        for (int k = 0; k < 3; k++) {
            double x = a[k][i], y = a[k][j];
            a[k][i] = c * x - t * y;
            a[k][j] = t * x + c * y;
            x = v[k][i], y = v[k][j];
            v[k][i] = c * x - t * y;
            v[k][j] = t * x + c * y;
        }
        for (int k = 0; k < 3; k++) {
            double x = a[i][k], y = a[j][k];
            a[i][k] = c * x - t * y;
            a[j][k] = t * x + c * y;
        }
    }
    for (int k = 0; k < 3; k++) {
        ps[k] = a[k][k];
        for (int i = 0; i < 3; i++)
            an[k + 3 * i] = v[i][k];
    }
}
