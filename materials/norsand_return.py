"""Return of stress to NorSand's yield surface, one row after the other (Jefferies 1993; Jefferies & Been 2015).

Here pressure P, q and plastic compaction are positive. Yield q = m P (1 + r) with r = ln(P_i/P), flow D = m - q/P =
-m r and the deviator keeps its direction, so that m, which depends on Lode's angle, is that of the trial.
"""

import math

from periporo.core.numerics.jit import inlined, kernel

KILOPASCAL = 1e3
"""Pressure at which the critical void ratio is given."""

LEAST_SLOPE = 0.5
"""Share of M below which distance from the critical state does not bring it."""

_YIELD = 1e-11  # of the image pressure: a row that was returned before is not returned again
_ROUNDING = 1e-12  # of ln of the image pressure: Newton's last step leaves about its square
_SETTLED = 1e-8  # the same, of that by which M_i is known
_SWEEPS, _NEWTON = 60, 80


@inlined
def slope_at(slope, q, third):
    """M of Lode's angle t, with sin(3 t) = -27 J3/(2 q^3) = 1 in triaxial compression; `third` is J3.

    M - M^2/(3 + M) cos(3 t/2 + pi/4) has one angle of friction in compression and extension (Jefferies & Shuttle 2011).
    """
    cube = q * q * q
    sine = -13.5 * third / cube if cube > 0.0 else 1.0
    sine = min(max(sine, -1.0), 1.0)
    return slope - slope * slope / (3.0 + slope) * math.cos(0.5 * math.asin(sine) + 0.25 * math.pi)


@inlined
def image_state(image, void, law):
    """M_i over M and the largest P_i/P of hardening, by the state parameter psi_i at the image pressure."""
    slope, critical, index, dilatancy, coupling = law[3], law[4], law[5], law[6], law[7]
    state = void - critical + index * math.log(image / KILOPASCAL)
    share = 1.0 - coupling * dilatancy * abs(state) / slope
    share = share if share > LEAST_SLOPE else LEAST_SLOPE
    return share, math.exp(-dilatancy * state / (slope * share))


@inlined
def secant_bulk(pressure, compaction, law):
    """Bulk modulus of a step, exact for dP/d(compaction) = K_ref (P/P_ref)^n; its pressure after the step.

    The latter is 0 where the strain takes all of the pressure away.
    """
    reference, stiffness, exponent = law[0], law[1], law[2]
    tangent = stiffness * (pressure / reference) ** exponent
    x = tangent / pressure * compaction
    if abs(x) < 1e-7:
        bulk = tangent * (1.0 + 0.5 * exponent * x)
        return bulk, pressure + bulk * compaction
    if exponent == 1.0:
        grown = math.exp(x)
    else:
        base = 1.0 + (1.0 - exponent) * x
        grown = base ** (1.0 / (1.0 - exponent)) if base > 0.0 else 0.0
    return pressure * (grown - 1.0) / compaction, pressure * grown


@inlined
def strain_to(pressure, lowest, law):
    """Compaction, which is negative, that takes a pressure down to `lowest`."""
    reference, stiffness, exponent = law[0], law[1], law[2]
    scale = reference / stiffness
    if exponent == 1.0:
        return scale * math.log(lowest / pressure)
    k = 1.0 - exponent
    return scale * ((lowest / reference) ** k - (pressure / reference) ** k) / k


@inlined
def _trial_of(r, m, limit, growth, pressure, q, start, bulk, shear):
    """P and the plastic shear strain g that belong to `r`, what is left of the law of hardening, and its slope."""
    own = 3.0 * shear + bulk * m * m * r * (1.0 + r)
    g = (q - m * (1.0 + r) * pressure) / own
    new = pressure + bulk * m * r * g
    if not new > 0.0:
        return new, g, -math.inf, 1.0
    fall = math.exp(-r)
    rate = growth * fall * (fall * limit - 1.0)
    g_slope = -(m * pressure + g * bulk * m * m * (2.0 * r + 1.0)) / own
    slope = 1.0 + bulk * m * (g + r * g_slope) / new - growth * fall * (1.0 - 2.0 * fall * limit) * g - rate * g_slope
    return new, g, math.log(new) + r - start - rate * g, slope


@inlined
def _on_surface(r, m, limit, growth, pressure, q, image, bulk, shear):
    """P, r and the plastic shear strain g of the step, for M_i = `m` and a `limit` of hardening that do not change.

    For a given r, g = (q - m (1 + r) P)/(3 G + K m^2 r (1 + r)) and P + K m r g is the pressure; what is left,
    ln(P_i) = ln(P_i,n) + growth e^(-2r) (limit - e^r) g, is solved by Newton's method within a bracket, from the given
    `r` on. At the tip, r = -1, more pressure takes the surface along.
    """
    start, low, high = math.log(image), -1.0, q / (m * pressure) - 1.0
    r = min(max(r, low), high)
    new, g = pressure, 0.0
    for _ in range(_NEWTON):
        at = r
        new, g, off, slope = _trial_of(at, m, limit, growth, pressure, q, start, bulk, shear)
        if at == -1.0 and off >= 0.0:
            break
        low, high = (at, high) if off < 0.0 else (low, at)
        r = at - off / slope if slope > 0.0 and off > -math.inf else 0.5 * (low + high)
        if abs(r - at) <= _ROUNDING or high - low <= _ROUNDING:
            return new, at, g
        if r <= -1.0 and low == -1.0:
            r = -1.0  # the tip itself, which is looked at once
        elif not low < r < high:
            r = 0.5 * (low + high)
    return new, r, g


@inlined
def _returned(slope, pressure, q, image, void, bulk, shear, law):
    """P, q, P_i, the plastic work and whether they are found, of a trial pressure and q with M = `slope`.

    M_i and the limit of hardening are those of the image pressure after the step: tried, and bracketed where that does
    not settle. Soil that liquefies keeps the smallest pressure.
    """
    share, limit = image_state(image, void, law)
    m, lowest = slope * share, law[9]
    if q / (m * pressure) - 1.0 + math.log(pressure / image) <= _YIELD:
        return pressure, q, image, 0.0, True
    at, last, found = math.log(image), 0.0, False
    low = high = over = under = 0.0  # guesses of ln(P_i) and what is left of them, above and below 0
    new, r, g = pressure, at - math.log(pressure), 0.0
    for _ in range(_SWEEPS):
        new, r, g = _on_surface(r, m, limit, law[8] * slope / law[3], pressure, q, image, bulk, shear)
        off = math.log(new) + r - at if new > 0.0 else -math.inf
        found = abs(off) <= _SETTLED or new < lowest
        if found:
            break
        if off > 0.0:
            low, over, under = at, off, (0.5 * under if last > 0.0 else under)
        else:
            high, under, over = at, off, (0.5 * over if last < 0.0 else over)
        last = off
        at = (low * under - high * over) / (under - over) if over * under < 0.0 else at + off
        share, limit = image_state(math.exp(at), void, law)
        m = slope * share
    new = lowest if new < lowest else new
    image = new * math.exp(r)
    m = slope * image_state(image, void, law)[0]
    return new, m * (1.0 + r) * new, image, m * new * g, found


@inlined
def _numbers_of(numbers, b):
    n = numbers[b if numbers.shape[0] > 1 else 0]
    return n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10]


@inlined
def _third_invariant(stress, b, p):
    x, y, z, u = stress[b, 0] - p, stress[b, 1] - p, stress[b, 2] - p, stress[b, 3]
    if stress.shape[1] == 4:
        return z * (x * y - u * u)
    v, w = stress[b, 4], stress[b, 5]
    return x * (y * z - v * v) - u * (u * z - v * w) + w * (u * v - y * w)


@kernel
def advance(numbers, stress, strain_increment, state, dissipation, refused):
    """Advance all rows of `NorSand.compute_stress`; `refused` (n,) tells where no image pressure is found.

    `numbers` (n, 11) of each row, or (1, 11) of all: P_ref and K there, its exponent, M, the critical void ratio at 1
    kPa, lambda, chi_i, N, H, the smallest pressure and G/K. The state has the image pressure, the void ratio and
    `opened`; `dissipation` is a column, or -1. Rows without state, and open ones, stay as they are.
    """
    n = stress.shape[1]
    for b in range(stress.shape[0]):
        law = _numbers_of(numbers, b)
        lowest = law[9]
        refused[b] = False
        if dissipation >= 0:
            state[b, dissipation] = 0.0
        image, void = state[b, 0], state[b, 1]
        if image == 0.0:
            continue
        pressure = -(stress[b, 0] + stress[b, 1] + stress[b, 2]) / 3.0
        moves = False
        for c in range(n):
            moves |= strain_increment[b, c] != 0.0
        if state[b, 2] > 0.0 or pressure < lowest:
            if moves:
                _let_go(stress, b, lowest)
            if state[b, 2] > 0.0 or not moves:
                continue
            pressure = lowest
        expansion = strain_increment[b, 0] + strain_increment[b, 1] + strain_increment[b, 2]
        bulk, trial = secant_bulk(pressure, -expansion, law)
        void = (1.0 + void) * math.exp(expansion) - 1.0
        if trial < lowest:
            gap = expansion + strain_to(pressure, lowest, law)
            state[b, 1] = (1.0 + void) * math.exp(-gap) - 1.0
            state[b, 2] = gap
            _let_go(stress, b, lowest)
            continue
        shear = law[10] * bulk
        square = 0.0
        for c in range(n):
            mean, volume = (-pressure, expansion / 3.0) if c < 3 else (0.0, 0.0)
            deviator = stress[b, c] - mean + 2.0 * shear * (strain_increment[b, c] - volume)
            square += (1.5 if c < 3 else 3.0) * deviator * deviator
            stress[b, c] = deviator - (trial if c < 3 else 0.0)
        q = math.sqrt(square)
        slope = slope_at(law[3], q, _third_invariant(stress, b, -trial))
        new, new_q, image, work, found = _returned(slope, trial, q, image, void, bulk, shear, law)
        refused[b] = moves and not found
        scale = new_q / q if q > 0.0 else 0.0
        if new_q != q or new != trial:
            for c in range(n):
                stress[b, c] = scale * (stress[b, c] + (trial if c < 3 else 0.0)) - (new if c < 3 else 0.0)
        state[b, 0], state[b, 1] = image, void
        if dissipation >= 0:
            state[b, dissipation] = work


@inlined
def _let_go(stress, b, lowest):
    for c in range(stress.shape[1]):
        stress[b, c] = -lowest if c < 3 else 0.0


@kernel
def fill_image(numbers, stress, void, image):
    """Fill the image pressure (n,) Pa of the surface through each stress: its M_i is that of the image pressure."""
    for b in range(stress.shape[0]):
        law = _numbers_of(numbers, b)
        pressure = -(stress[b, 0] + stress[b, 1] + stress[b, 2]) / 3.0
        square = 0.0
        for c in range(stress.shape[1]):
            deviator = stress[b, c] + (pressure if c < 3 else 0.0)
            square += (1.5 if c < 3 else 3.0) * deviator * deviator
        q = math.sqrt(square)
        slope = slope_at(law[3], q, _third_invariant(stress, b, -pressure))
        image[b] = pressure
        for _ in range(_SWEEPS):
            share, _ = image_state(image[b], void[b], law)
            image[b] = pressure * math.exp(q / (slope * share * pressure) - 1.0)


@kernel
def fill_bulk(numbers, stress, bulk):
    """Fill the bulk modulus (n,) Pa at the pressure of each row."""
    for b in range(stress.shape[0]):
        law = _numbers_of(numbers, b)
        pressure = -(stress[b, 0] + stress[b, 1] + stress[b, 2]) / 3.0
        pressure = law[9] if pressure < law[9] else pressure
        bulk[b] = law[1] * (pressure / law[0]) ** law[2]
