"""Return mapping of viscoplastic modified Cam-Clay: many rows at once, and one by one where that is not enough."""

import math

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.elasticity import elastic_trial
from periporo.core.numerics.jit import inlined, kernel

_KILOPASCAL = 1e3
_YIELD_TOLERANCE = 1e-11  # of p_c^2: a row that was returned before is not returned again
_NEWTON_TOLERANCE = 1e-5  # of the stress: the last, quadratic step then leaves about its square
_SERIES = 1e-2  # largest exponent for which the series is exact to rounding
_FLOOR, _ELASTIC, _QUANTITIES = 8, 9, 12
_ROUNDS, _INNER_ROUNDS = 3, 2  # of Newton in vectors; in a flow nearly every row needs no more


@inlined
def bonding_exponents(bonding, c1, c2, specific_volume, compression, swelling):
    """b1, b2 of |p_c,bonded| = exp(b1) |p_c|^b2 in kPa (Borja 2004; Gallipoli et al. 2003).

    The virgin line of bonded soil is v = c (N - lambda ln|p|) with c = 1 - c1 (1 - exp(c2 xi)); that both p_c
    lie on one swelling line of slope kappa gives b1 = N (c - 1)/(lambda c - kappa) and b2 = (lambda - kappa)/
    (lambda c - kappa).
    """
    c = 1.0 + c1 * math.expm1(c2 * bonding)
    slope = compression * c - swelling
    return specific_volume * (c - 1.0) / slope, (compression - swelling) / slope


@inlined
def bonded_size(size, b1, b2):
    """Size in Pa of the ellipse of bonded soil."""
    return _KILOPASCAL * math.exp(b1) * (size / _KILOPASCAL) ** b2


@inlined
def _exponential(y):
    """exp(y): the series where it is exact to rounding, for most steps are small and it is faster."""
    return _series(y) if abs(y) < _SERIES else math.exp(y)


@inlined
def _series(y):
    return 1.0 + y * (1.0 + y / 2.0 * (1.0 + y / 3.0 * (1.0 + y / 4.0 * (1.0 + y / 5.0 * (1.0 + y / 6)))))


@inlined
def _overstressed_scale(w, radius_squared, size_squared, overstress):
    """Root of w^3 B + (V - P^2) w - V by Newton, started where w^2 B >= P^2.

    The cubic is convex and increases there: after the first step the iterates fall monotonically.
    """
    constant = overstress - size_squared
    for _ in range(100):
        square = w * w * radius_squared
        step = (w * (square + constant) - overstress) / (3.0 * square + constant)
        w -= step
        if abs(step) <= 1e-6 * w:
            break
    return w


@inlined
def _shear_scale(guess, u, u_slope, a2, size, hardening, overstress):
    """q/q_trial = w <= 1 on the (overstressed) yield surface, and dw/dx; see `_return_to_yield`."""
    radius_squared = u * u + a2
    size_squared = size * size
    if radius_squared <= size_squared:
        return 1.0, 0.0
    if overstress == 0.0:
        inverse = 1.0 / math.sqrt(radius_squared)
        w = size * inverse
        return w, -inverse * (hardening + w * inverse * u * u_slope)
    if not guess * abs(guess) * radius_squared > size_squared:
        guess = size / math.sqrt(radius_squared)
    w = _overstressed_scale(guess, radius_squared, size_squared, overstress)
    square = w * w
    curvature = 3.0 * square * radius_squared + overstress - size_squared
    return w, -2.0 * w * (size * hardening + square * u * u_slope) / curvature


@inlined
def _return_to_yield(p_trial, a2, size_start, floor, bulk, c, stiffening, overstress):
    """Plastic volumetric strain x, w = q/q_trial and new size P = |p_c| of a flowing row.

    The unknown is x = dgamma d with d = df/dp = 2 p + P: p = p_trial - K x and P = P_n exp(-x/(lambda -
    kappa)) follow from it without iteration. With u = d + c x, c = 6 mu/M^2 and a = 2 q_trial/M, flow in
    shear is w = d/u, and the yield condition with overstress V = 4 eta/(c dt) is w^2 (u^2 + a^2) = P^2 +
    V (1/w - 1), which gives w(x). What is left is T(x) = w u - d = 0. It is smooth, also at the critical
    state (u = d = x = 0), and nearly linear; its root lies between 0 and the x that takes p to the middle of
    the ellipse.
    """
    x, size, hardening = 0.0, size_start, size_start * stiffening
    low, high = 0.0, (2.0 * p_trial + size_start) / (2.0 * bulk)
    dilates = high > 0.0
    w = 0.0
    for iteration in range(200):
        d = 2.0 * (p_trial - bulk * x) + size
        d_slope = -2.0 * bulk - hardening
        u, u_slope = d + c * x, d_slope + c
        w, w_slope = _shear_scale(w, u, u_slope, a2, size, hardening, overstress)
        residual = (w - 1.0) * d + w * c * x
        step = -residual / (w_slope * u + (w - 1.0) * d_slope + w * c)
        small = _NEWTON_TOLERANCE * min(size, size_start)
        if abs(residual) <= small and abs(step * d_slope) <= small:
            x += step
            w += w_slope * step
            size -= hardening * step * (1.0 - 0.5 * stiffening * step)
            break
        if (residual > 0.0) == dilates:
            high = x
        else:
            low = x
        new = x + step
        if not (new - low) * (new - high) < 0.0 or iteration % 8 == 7:  # Newton may cycle: bisect
            new = 0.5 * (low + high)
        if new == x:
            break
        w += w_slope * (new - x)
        x = new
        size = size_start * _exponential(-stiffening * x)
        hardening = size * stiffening
        if size < floor:
            size, hardening = floor, 0.0
    return x, w, max(size, floor)


@inlined
def _secant_bulk(swelling, minimum, b, stress, strain_increment):
    """Bulk modulus of row b by which the strain of the step takes the pressure P to P exp(-strain/kappa)."""
    p = (stress[b, 0] + stress[b, 1] + stress[b, 2]) / 3.0
    pressure = minimum if -p < minimum else -p
    exponent = (strain_increment[b, 0] + strain_increment[b, 1] + strain_increment[b, 2]) / swelling
    return pressure / swelling * (-math.expm1(-exponent) / exponent if abs(exponent) > 1e-8 else 1.0)


@inlined
def _return_tile(tile):
    """`_return_to_yield` of all lanes at once: from p_trial, a^2, P_n, stiffening to x, w, P, and 1 where it is done.

    The bulk modulus, c and the overstress V are quantities `_ELASTIC` ... of the lanes.

    A fixed number of Newton steps without a branch. A lane that has not arrived by then, leaves the ellipse or needs
    more than the series of the exponential gives up.
    """
    for k in range(LANES):
        p_trial, a2, size_start, stiffening = la.from_lane(tile, 0, k, (0.0, 0.0, 0.0, 0.0))
        bulk, c, overstress = la.from_lane(tile, _ELASTIC, k, (0.0, 0.0, 0.0))
        x, w, size = 0.0, 1.0, size_start
        found = 1.0
        for iteration in range(_ROUNDS):
            hardening = size * stiffening
            d = 2.0 * (p_trial - bulk * x) + size
            d_slope = -2.0 * bulk - hardening
            u, u_slope = d + c * x, d_slope + c
            radius_squared, size_squared = u * u + a2, size * size
            constant = overstress - size_squared
            w = size / math.sqrt(radius_squared)
            inner = 0.0
            for _ in range(_INNER_ROUNDS):
                square = w * w * radius_squared
                inner = (w * (square + constant) - overstress) / (3.0 * square + constant)
                w -= inner
            square = w * w
            w_slope = -2.0 * w * (size * hardening + square * u * u_slope) / (3.0 * square * radius_squared + constant)
            residual = (w - 1.0) * d + w * c * x
            step = -residual / (w_slope * u + (w - 1.0) * d_slope + w * c)
            inside = radius_squared > size_squared and abs(inner) <= 1e-6 * w
            found = found if inside else 0.0
            if iteration == _ROUNDS - 1:
                small = _NEWTON_TOLERANCE * min(size, size_start)
                found = found if abs(residual) <= small and abs(step * d_slope) <= small else 0.0
                size -= hardening * step * (1.0 - 0.5 * stiffening * step)
                w += w_slope * step
            x += step
            exponent = -stiffening * x
            found = found if abs(exponent) < _SERIES else 0.0
            if iteration < _ROUNDS - 1:
                size = size_start * _series(exponent)
        high = (2.0 * p_trial + size_start) / (2.0 * bulk)
        found = found if x * (x - high) <= 0.0 else 0.0
        la.to_lane(tile, 4, k, (x, w, size, found))


@inlined
def _bonded(unbonded, minimum, index, state, b, column, numbers, r):
    """Size, floor and stiffening of row b with `numbers` r, those of unbonded soil where there is no bonding."""
    if column >= 0 and state[b, column] != 0.0:
        n = numbers[r]
        b1, b2 = bonding_exponents(state[b, column], n[6], n[7], n[8], n[9], n[10])
        return bonded_size(unbonded, b1, b2), bonded_size(minimum, b1, b2), index * b2
    return unbonded, minimum, index


@inlined
def _elasticity_of(numbers, r):
    """K, mu and kappa, or 0, of row r."""
    return numbers[r, 0], numbers[r, 1], numbers[r, 11]


@inlined
def _flow_of(numbers, r):
    """6/M^2, 4 eta, the least |p_c| and 1/(lambda - kappa) of row r."""
    return numbers[r, 2], numbers[r, 3], numbers[r, 4], numbers[r, 5]


@kernel
def advance(numbers, dt, stress, strain_increment, state, bonding_column, dissipation_column):
    """Advance all rows of `CamClay.compute_stress`; a column that the state lacks is -1.

    `numbers` (n, 12) of each row, or (1, 12) of all: K, mu, 6/M^2, 4 eta, the least |p_c|, 1/(lambda - kappa), five of
    the bonding, and 0; where K follows the pressure, that is kappa and mu stands for G/K.
    """
    own = numbers.shape[0] > 1
    differs = own or numbers[0, 11] > 0.0  # between rows, in elasticity
    tile, rows, used = np.ones(_QUANTITIES * LANES), np.zeros(LANES, np.int64), 0
    bulk, shear, swelling = _elasticity_of(numbers, 0)
    per_slope, viscosity, minimum, index = _flow_of(numbers, 0)
    c = per_slope * shear
    for k in range(LANES):
        la.to_lane(tile, _ELASTIC, k, (bulk, c, viscosity / (c * dt)))
    for b in range(stress.shape[0]):
        r = b if own else 0
        if dissipation_column >= 0:
            state[b, dissipation_column] = 0.0
        if differs:
            bulk, shear, swelling = _elasticity_of(numbers, r)
            per_slope, viscosity, minimum, index = _flow_of(numbers, r)
            if swelling > 0.0:
                bulk = _secant_bulk(swelling, minimum, b, stress, strain_increment)
                shear *= bulk
        p_trial, square = elastic_trial(bulk, shear, 1.0, b, stress, strain_increment)
        a2 = per_slope * square
        unbonded = minimum if -state[b, 0] < minimum else -state[b, 0]  # keeps NaN, unlike max
        size, floor, stiffening = _bonded(unbonded, minimum, index, state, b, bonding_column, numbers, r)
        if 0.25 * a2 + p_trial * (p_trial + size) > _YIELD_TOLERANCE * size * size:
            la.to_lane(tile, 0, used, (p_trial, a2, size, stiffening))
            tile[_FLOOR * LANES + used] = floor
            if differs:
                c = per_slope * shear
                la.to_lane(tile, _ELASTIC, used, (bulk, c, viscosity / (c * dt)))
            rows[used] = b
            used += 1
        if used < LANES and (b < stress.shape[0] - 1 or used == 0):
            continue
        _return_tile(tile)
        for k in range(used):
            if own:
                _, _, minimum, index = _flow_of(numbers, rows[k])
            _take_back(tile, k, rows[k], minimum, index, stress, state, dissipation_column)
        used = 0


@inlined
def _take_back(tile, k, b, minimum, index, stress, state, dissipation_column):
    """Write stress and p_c of lane k to row b, after a return of its own where the tile found none."""
    p_trial, a2, size, stiffening = la.from_lane(tile, 0, k, (0.0, 0.0, 0.0, 0.0))
    x, w, new_size, found = la.from_lane(tile, 4, k, (0.0, 0.0, 0.0, 0.0))
    floor, bulk, c, overstress = la.from_lane(tile, _FLOOR, k, (0.0, 0.0, 0.0, 0.0))
    if found == 0.0 or new_size < floor:
        x, w, new_size = _return_to_yield(p_trial, a2, size, floor, bulk, c, stiffening, overstress)
    p = p_trial - bulk * x
    for m in range(3):
        stress[b, m] = p + w * (stress[b, m] - p_trial)
    for m in range(3, stress.shape[1]):
        stress[b, m] *= w
    if stiffening == index:
        state[b, 0] = -new_size
    else:
        unbonded = minimum if -state[b, 0] < minimum else -state[b, 0]
        state[b, 0] = -max(unbonded * math.exp(-index * x), minimum)
    if dissipation_column >= 0:
        state[b, dissipation_column] = p * x + w * (1.0 - w) * a2 / (2.0 * c)
