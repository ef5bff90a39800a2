"""Small scenes drawn at random: bodies of all laws and shapes that meet each other and obstacles, in any scheme."""

from pathlib import Path

import numpy as np

SEED = 1915
SCHEMES = (
    None, None, {"scheme": "point_state"}, {"scheme": "point_state", "sharpened": True}, {"scheme": "bond_projected"},
    {"scheme": "bond_projected", "dilatation": "points"}, {"scheme": "standard"}, {"scheme": "sub_horizon"},
)  # fmt: skip
"""None is the default. The published sub-horizon force is not among them: it is known to create energy."""
INFLUENCES = ("cubic", "conical", "gaussian")
LAWS = ("elastic", "drucker_prager", "cam_clay", "arena", "mohr_coulomb")
SPACING = 0.01
CELL = 8  # spacings: each body has a square, or cube, of its own


def draw(number: int, folder: Path) -> dict:
    """Scene `number`, the same whatever was drawn before; files that it needs are written to `folder`."""
    rng = np.random.default_rng([SEED, number])
    d = 3 if rng.random() < 0.2 else 2
    alone = rng.random() < 0.25  # nothing acts from outside
    laws = [str(name) for name in rng.choice(LAWS, size=rng.integers(1, 3), replace=False)]
    scheme = SCHEMES[rng.integers(len(SCHEMES))]
    scene = {
        "dimension": d, "spacing": SPACING, "seed": number, "horizon": float(rng.uniform(2.0, 2.8)),
        "influence": str(rng.choice(INFLUENCES)), "materials": {name: _material(rng, name) for name in laws},
        "time_step": {"safety": float(rng.uniform(0.4, 0.9))}, "output": {"interval": 1.0},
    }  # fmt: skip
    if scheme is not None:
        scene["correspondence"] = dict(scheme)
    if not alone and rng.random() < 0.8:
        scene["gravity"] = [0.0] * (d - 1) + [-float(rng.choice([1.0, 9.81, 50.0]))]
    scene["bodies"] = _bodies(rng, d, laws)
    names = [f"stage{k}" for k in range(rng.integers(1, 4))]
    scene["stages"] = [{"name": n, "type": "dynamics", "duration": float(rng.uniform(0.01, 0.04))} for n in names]
    scene["contacts"] = _between_bodies(rng, scene["bodies"], names)
    if not alone:
        if len(names) > 1 and rng.random() < 0.15:
            scene["stages"][0] = {"name": names[0], "type": "relax", "tolerance": 1e-2, "max_displacement": 10.0}
        scene["contacts"] += [_obstacle(rng, d, names, folder) for _ in range(rng.integers(1, 4))]
        _load(rng, scene, d)
    if rng.random() < 0.1:
        scene["stages"][-1]["damping"] = {"viscous": float(10 ** rng.uniform(0, 4))}
    return scene


def _material(rng, law):
    stiffness = float(10 ** rng.uniform(5.5, 7.0))
    shear = stiffness * float(rng.uniform(0.1, 1.0))
    moduli = {"bulk_modulus": stiffness, "shear_modulus": shear}
    if law == "elastic":
        return {"model": law, "density": 1800.0} | moduli
    if law == "arena":
        return {"model": law, "initial_porosity": float(rng.uniform(0.3, 0.45)), "p0": 1e4, "G0": 1e7, "b0": 1e-4}
    if law == "cam_clay":
        return {
            "model": law, "grain_density": 2650.0, "porosity": 0.35,
            "critical_state_slope": float(rng.uniform(0.6, 1.5)),
            "compression_index": 0.03, "swelling_index": 0.005, "preconsolidation": float(10 ** rng.uniform(2, 4)),
            "viscosity": float(rng.choice([0.0, 1e6])),
        } | moduli  # fmt: skip
    strength = {"cohesion": float(rng.choice([0.0, 300.0, 5000.0])), "friction_angle": float(rng.uniform(5.0, 40.0))}
    strength["dilation_angle"] = strength["friction_angle"] * float(rng.choice([0.0, 0.3]))
    model = law if law == "drucker_prager" or rng.random() < 0.5 else "mohr_coulomb_numba"
    return {"model": model, "density": 1800.0} | moduli | strength


def _bodies(rng, d, laws):
    """Two to five bodies in cells beside and above each other, some of which fill theirs and so touch."""
    across = np.array([2, 3]) if d == 2 else np.array([2, 2, 2])
    cells = np.stack(np.meshgrid(*map(np.arange, across), indexing="ij"), axis=-1).reshape(-1, d)
    chosen = cells[rng.choice(len(cells), size=rng.integers(2, 6), replace=False)]
    size = CELL if d == 2 else 5
    speed = float(rng.choice([0.05, 0.5, 2.0, 8.0]))
    bodies = []
    for k, cell in enumerate(chosen):
        lower = cell * size * SPACING
        body = {"name": f"b{k}", "material": str(rng.choice(laws)), "shape": _shape(rng, d, lower, size)}
        if rng.random() < 0.7:
            towards = (0.5 * across - cell - 0.5) + rng.normal(size=d)
            body["velocity"] = (speed * towards / np.linalg.norm(towards)).tolist()
        if rng.random() < 0.15:
            body["jitter"] = 0.2
        bodies.append(body)
    return bodies


def _shape(rng, d, lower, size):
    kind = rng.choice(["full", "box", "round", "polygon"])
    h = SPACING
    if kind == "full":
        return {"type": "box", "lower": lower.tolist(), "upper": (lower + size * h).tolist()}
    if kind == "box":
        counts = rng.integers(3, size, size=d)
        start = lower + h * rng.uniform(0.0, 1.0, size=d) * (size - counts)
        return {"type": "box", "lower": start.tolist(), "upper": (start + counts * h).tolist()}
    centre, radius = lower + 0.5 * size * h, h * float(rng.uniform(0.35, 0.5)) * size
    if kind == "round":
        return {"type": "disc" if d == 2 else "sphere", "center": centre.tolist(), "radius": radius}
    count = int(rng.integers(3, 7))
    angles = 2.0 * np.pi * (rng.random() + np.arange(count) / count)
    vertices = centre[:2] + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    shape = {"type": "polygon", "vertices": vertices.tolist()}
    return shape if d == 2 else shape | {"extrude": [float(lower[2]), float(lower[2] + size * h)]}


def _between_bodies(rng, bodies, stages):
    law = {"type": "bodies", "friction": _friction(rng), "damping": float(rng.choice([0.0, 0.0, 0.2]))}
    kind = rng.choice(["all", "all", "all", "none", "switched", "pairs"])
    if kind == "none":
        return []
    if kind == "switched" and len(stages) > 1:
        return [law | {"between": "all", "stages": _some(rng, stages)}]
    if kind == "pairs":
        first, second = (b["name"] for b in bodies[:2])
        return [law | {"between": "all"}, law | {"first": first, "second": second, "friction": _friction(rng)}]
    return [law | {"between": "all"}]


def _obstacle(rng, d, stages, folder):
    """An obstacle below or beside the bodies, that may come towards them, in some stages."""
    size = SPACING * (CELL if d == 2 else 5)
    upper = size * (np.array([2, 3]) if d == 2 else np.array([2, 2, 2]))
    gap = SPACING * float(rng.choice([0.0, rng.uniform(0.0, 3.0)]))
    law = {"friction": _friction(rng), "damping": float(rng.choice([0.0, 0.0, 0.5]))}
    if rng.random() < 0.15:
        law["stiffness"] = float(10 ** rng.uniform(8, 10.5))
    if rng.random() < 0.35 and len(stages) > 1:
        law["stages"] = _some(rng, stages)
    kind = str(rng.choice(["plane", "plane", "box", "round", "ground", "short_range_published"]))
    if kind == "short_range_published":
        lower = [-size] * (d - 1) + [-4 * SPACING]
        top = [3 * size] * (d - 1) + [-gap - 0.5 * SPACING]  # beyond the reach of its force
        law = {k: law[k] for k in ("friction", "stages") if k in law}
        return law | {"type": kind, "stiffness": 4e6, "substrate": {"lower": lower, "upper": top}}
    towards = np.zeros(d)
    if kind == "plane":
        normal = np.eye(d)[-1] + 0.4 * rng.normal(size=d) * (rng.random() < 0.6)
        normal /= np.linalg.norm(normal)
        corner = np.where(normal > 0.0, 0.0, upper)
        place = {"point": (corner - gap * normal).tolist(), "normal": normal.tolist()}
        towards = normal
    elif kind == "box":
        axis, side = int(rng.integers(d)), int(rng.choice([-1, 1]))
        low, high = -0.3 * size * rng.random(d), upper * rng.uniform(0.4, 1.2, size=d)
        low[axis], high[axis] = (-gap - size, -gap) if side < 0 else (upper[axis] + gap, upper[axis] + gap + size)
        place = {"lower": low.tolist(), "upper": high.tolist()}
        towards[axis] = -side
    elif kind == "round":
        radius = size * float(rng.uniform(0.2, 1.0))
        centre = upper * rng.random(d)
        centre[-1] = -gap - radius
        towards[-1] = 1.0
        if d == 2:
            kind, place = "disc", {"center": centre.tolist(), "radius": radius}
        else:
            kind = "cylinder"
            base = [-size, float(centre[1]), float(centre[2])]
            place = {"base": base, "axis": "x", "radius": radius, "height": 4 * size}
    else:
        kind, place = _ground(rng, d, size, gap, folder)
        towards[-1] = 1.0
    if rng.random() < 0.35:
        way = towards + 0.5 * rng.normal(size=d)
        law["velocity"] = (float(rng.choice([0.05, 0.5, 2.0])) * way).tolist()
    return law | {"type": kind} | place


def _ground(rng, d, size, gap, folder):
    depth = -gap - size * np.abs(rng.normal(size=9)) * 0.3
    if d == 2:
        x = [-10 * size, -size, *np.sort(rng.uniform(-0.5, 2.5, 3)) * size, 3 * size, 12 * size]
        y = [2 * size, *depth[:5], 2 * size]
        return "polyline", {"vertices": np.column_stack([x, y]).tolist()}
    rows = "\n".join(" ".join(f"{z:.6f}" for z in row) for row in depth.reshape(3, 3))
    name = f"ground{rng.integers(10**6)}.asc"
    head = f"ncols 3\nnrows 3\nxllcenter {-size}\nyllcenter {-size}\ncellsize {2 * size}\n"
    (folder / name).write_text(head + rows + "\n")
    return "terrain", {"ground": {"file": name}}


def _load(rng, scene, d):
    """A traction, a push or a hold on an edge of a body in some of the scenes."""
    if rng.random() > 0.3:
        return
    body = scene["bodies"][0]["name"]
    kind = rng.choice(["fix", "velocity", "traction"])
    where = {"body": body}
    if kind == "fix":
        entry = {"where": where, "fix": ["x"]}
    elif kind == "velocity":
        entry = {"where": where, "velocity": {"x": float(rng.normal())}}
    else:
        stress = (200.0 * rng.normal(size=d)).tolist()
        entry = {"where": where, "traction": {"stress": stress, "side": str(rng.choice(["x-", "x+", "y+"]))}}
    scene["boundaries"] = {"load": entry}
    for stage in scene["stages"][-1:]:
        stage["boundaries"] = ["load"]


def _friction(rng):
    return float(rng.choice([0.0, rng.uniform(0.0, 1.0), 1.0]))


def _some(rng, stages):
    chosen = [s for s in stages if rng.random() < 0.5]
    return chosen or [stages[-1]]
