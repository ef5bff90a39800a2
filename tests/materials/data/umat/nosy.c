/* Elastic laws with wishes: PROPS are K, mu, what it reads (1 TEMP, 2 STRAN, 3 CELENT, 4 TIME; 5 and 6: nothing, it
   adds strain up behind its first state variable, with engineering shear or as a tensor; 7 COORDS, 8 DFGRD0 and
   DFGRD1), longest strain. */
#include <math.h>

extern void sinv_(const double *, double *, double *, const int *, const int *);

void sdvini_(double *statev, double *coords, int *nstatv, int *ncrds, int *noel, int *npt, int *layer, int *kspt)
{
    for (int i = 0; i < *nstatv; i++)
        statev[i] = i + 1;
}

void umat_(double *stress, double *statev, double *ddsdde, double *sse, double *spd, double *scd, double *rpl,
           double *ddsddt, double *drplde, double *drpldt, double *stran, double *dstran, double *time, double *dtime,
           double *temp, double *dtemp, double *predef, double *dpred, char *cmname, int *ndi, int *nshr, int *ntens,
           int *nstatv, double *props, int *nprops, double *coords, double *drot, double *pnewdt, double *celent,
           double *dfgrd0, double *dfgrd1, int *noel, int *npt, int *layer, int *kspt, int *kstep, int *kinc,
           unsigned long cmname_length)
{
    double lame = props[0] - 2.0 / 3.0 * props[1], mean, mises, length = 0.0;
    int n = *ntens, reads = (int)props[2];
    for (int i = 0; i < n; i++)
        length = fmax(length, fabs(dstran[i]));
    if (length > props[3]) {
        *pnewdt = 0.25;
        return;
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            ddsdde[i + n * j] = (i < 3 && j < 3 ? lame : 0.0) + (i == j ? (i < 3 ? 2.0 : 1.0) * props[1] : 0.0);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            stress[i] += ddsdde[i + n * j] * dstran[j];
    sinv_(stress, &mean, &mises, ndi, nshr);
    if (reads == 5 || reads == 6) {
        for (int i = 0; i < n; i++)
            statev[1 + i] += (i > 2 && reads == 6 ? 0.5 : 1.0) * dstran[i];
    } else if (*nstatv > 2) {
        statev[0] = mises;
        statev[1] = reads == 2 ? stran[3] : reads == 3 ? *celent : reads == 4 ? time[1] : reads == 7 ? coords[1]
                    : reads == 8 ? dfgrd1[3] - dfgrd0[3] : 0.0;
    }
    if (reads == 1)
        stress[0] += *temp;
    if (reads > 6 && *nstatv <= 2)
        stress[0] += 0.0 * (reads == 7 ? coords[2] : dfgrd0[8] + dfgrd1[8]);
    if (reads > 1 && reads < 5 && *nstatv <= 2)
        stress[0] += 0.0 * (reads == 2 ? stran[0] : reads == 3 ? *celent : time[0]);
}
