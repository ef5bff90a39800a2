/* Drucker-Prager without tension cut-off: PROPS are K, mu, eta, xi c, eta_bar; STATEV(1) the plastic shear strain. */
#include <math.h>

void umat_(double *stress, double *statev, double *ddsdde, double *sse, double *spd, double *scd, double *rpl,
           double *ddsddt, double *drplde, double *drpldt, double *stran, double *dstran, double *time, double *dtime,
           double *temp, double *dtemp, double *predef, double *dpred, char *cmname, int *ndi, int *nshr, int *ntens,
           int *nstatv, double *props, int *nprops, double *coords, double *drot, double *pnewdt, double *celent,
           double *dfgrd0, double *dfgrd1, int *noel, int *npt, int *layer, int *kspt, int *kstep, int *kinc,
           unsigned long cmname_length)
{
    double bulk = props[0], shear = props[1], eta = props[2], strength = props[3], dilation = props[4];
    double lame = bulk - 2.0 / 3.0 * shear, volume = lame * (dstran[0] + dstran[1] + dstran[2]), j2 = 0.0;
    int n = *ntens;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            ddsdde[i + n * j] = (i < 3 && j < 3 ? lame : 0.0) + (i == j ? (i < 3 ? 2.0 : 1.0) * shear : 0.0);
    for (int i = 0; i < n; i++)
        stress[i] += i < 3 ? volume + 2.0 * shear * dstran[i] : shear * dstran[i];
    double p = (stress[0] + stress[1] + stress[2]) / 3.0;
    for (int i = 0; i < n; i++)
        j2 += i < 3 ? 0.5 * (stress[i] - p) * (stress[i] - p) : stress[i] * stress[i];
    double root = sqrt(j2), excess = root + eta * p - strength;
    if (!(excess > 0.0))
        return;
    double flow = excess / (shear + bulk * eta * dilation), apex = strength / eta;
    double new_p = p - bulk * dilation * flow, new_root = root - shear * flow;
    if (new_p > apex) {
        new_p = apex;
        new_root = 0.0;
    }
    double scale = root > 0.0 ? new_root / root : 0.0;
    for (int i = 0; i < n; i++)
        stress[i] = i < 3 ? new_p + scale * (stress[i] - p) : scale * stress[i];
    statev[0] += (root - new_root) / shear;
    *spd = new_p * (p - new_p) / bulk + new_root * (root - new_root) / shear;
}
