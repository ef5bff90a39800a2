! Hooke's law: PROPS are bulk and shear modulus.
subroutine umat(stress, statev, ddsdde, sse, spd, scd, rpl, ddsddt, drplde, drpldt, stran, dstran, time, dtime, temp, &
    dtemp, predef, dpred, cmname, ndi, nshr, ntens, nstatv, props, nprops, coords, drot, pnewdt, celent, dfgrd0, &
    dfgrd1, noel, npt, layer, kspt, kstep, kinc)
    implicit none
    character(len=80) :: cmname
    integer :: ndi, nshr, ntens, nstatv, nprops, noel, npt, layer, kspt, kstep, kinc
    double precision :: stress(ntens), statev(nstatv), ddsdde(ntens, ntens), sse, spd, scd, rpl, ddsddt(ntens)
    double precision :: drplde(ntens), drpldt, stran(ntens), dstran(ntens), time(2), dtime, temp, dtemp, predef(1)
    double precision :: dpred(1), props(nprops), coords(3), drot(3, 3), pnewdt, celent, dfgrd0(3, 3), dfgrd1(3, 3)
    double precision :: lame
    integer :: i, j
    lame = props(1) - 2d0/3d0*props(2)
    ddsdde = 0d0
    do i = 1, ndi
        do j = 1, ndi
            ddsdde(i, j) = lame
        end do
        ddsdde(i, i) = lame + 2d0*props(2)
    end do
    do i = ndi + 1, ntens
        ddsdde(i, i) = props(2)
    end do
    stress = stress + matmul(ddsdde, dstran)
    if (cmname(1:8) /= 'PERIPORO') stress = 0d0
end subroutine
