"""Damage to valid scenes, each of which makes the scene invalid by construction.

`structural` goes through every entry of a scene, the others need to know what a scene means. All yield (what was
done, key path of the damage, scene), or texts where the damage lies below the data.
"""

import copy

import yaml

from periporo.io.schema.scene import scene_json_schema
from periporo.materials import registry

NOT_NUMBERS = [float("nan"), float("inf"), -float("inf"), -1e300, True, "abc", "1e-1 m", "½", "１２", [1], {"a": 1}]
NOT_WORDS = ["no such/word", "../../etc/passwd", "\u202e", "a" * 500, "", 1e3, False, [], ["x"], {"a": 1}]
NOT_BRANCHES = [True, "text", 7, 1e9]
NAMED = ("materials", "boundaries")  # keys below these are names, which may be anything
LOOKALIKE = str.maketrans("aceopxy", "асеорху")  # Cyrillic letters that look the same
FILES = [  # names of a result file that lead out of the working folder, or are no names
    "../x.h5", "a/../../x.h5", "/tmp/x.h5", "~/x.h5", "~root/x.h5", "..\\x.h5", "C:\\x.h5", "x\0.h5", "x\n.h5", "..",
    ".", "/", "", "x", "x.h5/..", "x.exe", "x.yaml", ".h5", "a" * 300 + ".h5", 7, True, ["x.h5"], {"x": "h5"},
]  # fmt: skip
POSITIVE = ("density", "grain_density", "bulk_modulus", "shear_modulus", "compression_index", "p0", "p1", "G0")
SOURCES = ["/dev/zero", "/dev/null", "/etc/passwd", "/", ".", "..", "", "nowhere.csv", "a\0b", "a" * 5000, "~", 1, []]


def required_keys():
    """Keys that are required wherever they occur in the schema."""
    laws = [law.model_json_schema() for law in map(registry.load, ("arena", "cam_clay", "drucker_prager", "elastic"))]
    models = [scene_json_schema(), *laws, *scene_json_schema()["$defs"].values()]
    required = {key for model in models for key in model.get("required", [])}
    return required - {key for model in models for key in model["properties"] if key not in model.get("required", [])}


REQUIRED = required_keys()


def places(value, path=(), most=None):
    """(path, value) of everything below the top; of a list only the first `most` entries."""
    for part, entry in list(value.items()) if isinstance(value, dict) else list(enumerate(value))[:most]:
        yield (*path, part), entry
        if isinstance(entry, dict | list):
            yield from places(entry, (*path, part), most)


def edited(data, path, edit):
    """A copy of the scene in which `edit` was applied to the parent of the entry at `path`."""
    changed = copy.deepcopy(data)
    parent = changed
    for part in path[:-1]:
        parent = parent[part]
    edit(parent, path[-1])
    return changed


def changed(data, path, value):
    """A copy of the scene with a new value at `path`."""
    return edited(data, path, lambda parent, key: parent.__setitem__(key, value))


def renamed(parent, key, new):
    """Give an entry of a mapping a new key in its place."""
    entries = [(new if k == key else k, v) for k, v in parent.items()]
    parent.clear()
    parent.update(entries)


def wrong_values(path, value):
    """Values that cannot stand in the place of `value`, whatever the key means."""
    if value is None or path[-1] in ("title", "name", "file"):
        return [1e3, [], {"a": 1}, "\0", "x" * 5000] if value is not None else []
    if isinstance(value, bool):
        return [v for v in NOT_NUMBERS if v is not True]
    if isinstance(value, int | float):
        return NOT_NUMBERS if path[0] == "materials" else [*NOT_NUMBERS, 1e300, 10**40]
    if path[-1] == "mean":  # of a random field: a number, or a field of depth or level
        return [v for v in NOT_BRANCHES if isinstance(v, bool | str)]
    return NOT_WORDS if isinstance(value, str) else NOT_BRANCHES


def may_be_empty(path, wrong):
    """Whether an empty list means something there."""
    return (path[:2] == ("output", "fields") and wrong == []) or (path[-1] == "where" and not wrong)


def structural(data, most=None):
    """Wrong types, NaN, huge numbers, missing, misspelt and unknown keys, in every place."""
    for path, value in places(data, most=most):
        is_key = isinstance(path[-1], str) and (len(path) < 2 or path[-2] not in NAMED)
        for wrong in wrong_values(path, value):
            if not may_be_empty(path, wrong):
                yield f"= {wrong!r:.20}", path, changed(data, path, wrong)
        if is_key and path[-1] in REQUIRED:
            yield "missing", path, edited(data, path, lambda p, k: p.pop(k))
        if is_key and len(path[-1]) > 3:
            typo = path[-1][:1] + path[-1][2:]
            yield "misspelt", (*path[:-1], typo), edited(data, path, lambda p, k, t=typo: renamed(p, k, t))
        if is_key:
            strange = "schlüssel"
            yield "unknown", (*path[:-1], strange), edited(data, path, lambda p, k, s=strange: p.update({s: 1}))


def lookalikes(data):
    """Keys with letters of another script, or with characters that have no width."""
    for path, _ in places(data, most=1):
        if isinstance(path[-1], str) and (len(path) < 2 or path[-2] not in NAMED):
            twin = path[-1].translate(LOOKALIKE)
            for new in (twin, path[-1] + "\u200b", "\ufeff" + path[-1]):
                if new != path[-1]:
                    place = (*path[:-1], new)
                    yield "lookalike", place, edited(data, path, lambda p, k, n=new: renamed(p, k, n))


def out_of_range(data):
    """Numbers that no soil and no computer has."""
    wrong = {
        ("spacing",): [0, -1e-3, 1e-7, 1e5, 1e3],
        ("horizon",): [0, 1.49, 6.01, -2],
        ("seed",): [-1, 2**63, 1.5],
        ("gravity",): [[0], [0, 0, 0, -9.81], [0, -1e7], []],
        ("time_step",): [{"safety": 0}, {"safety": 1.01}, {"fixed": 0}, {"fixed": -1}, {"update": 0}, {"update": 1.5}],
        ("output", "interval"): [0, -1, 1e10],
        ("output", "history_interval"): [0, -1, 2.5, 10**7],
        ("output", "fields"): [["no_such_field"], ["stress", "stress "], ["x" * 70], [1], "stress", ["stress"] * 101],
        ("checkpoint",): [{"interval": 0}, {"interval": 1e8}, {"keep": 0}, {"keep": 1.5}, {"keep": 1001}, [600]],
        ("monitor",): [{"energy_tolerance": 0}, {"energy_tolerance": 2}, {"points": [[0]]}, {"points": [0, 0]}],
    }
    base = {"output": {}} | data
    for path, values in wrong.items():
        for value in values:
            yield f"= {value!r:.30}", path, changed(base, path, value)
    for name, law in data["materials"].items():
        for parameter in filter(law.__contains__, POSITIVE):
            for value in (0, -1, 1e40):
                path = ("materials", name, parameter)
                yield f"= {value}", path, changed(data, path, value)


def contradictory(data):
    """Entries that are valid each for itself, but not together."""
    d, add = data["dimension"], lambda path, value: (path, changed(data, path, value))
    yield "other dimension", *add(("dimension",), 5 - d)
    body = data["bodies"][0]
    yield "same body twice", *add(("bodies",), [*data["bodies"], body])
    yield "bodies overlap", *add(("bodies",), [*data["bodies"], body | {"name": "twin"}])
    yield "no body", *add(("bodies",), [])
    far = {"type": "box", "lower": [900.0] * d, "upper": [900.0 + 0.3 * data["spacing"]] * d}
    yield "body below the spacing", *add(("bodies",), [*data["bodies"], body | {"name": "small", "shape": far}])
    for kind, shape in wrong_shapes(d):
        yield kind, *add(("bodies", 0, "shape"), shape)
    for file in SOURCES:
        yield f"points from {file!r:.20}", *add(("bodies", 0, "shape"), {"type": "points", "file": file})
        water = {"suction": 1e3, "retention": {"table": file}}
        yield f"retention from {file!r:.20}", *add(("pore_water",), water)
    yield "water without curve", *add(("pore_water",), {"suction": 1e3, "retention": {}})
    yield "water of two curves", *add(("pore_water",), {"suction": 1e3, "retention": {"set": "fitted", "alpha1": 1.0}})
    yield "suction below zero", *add(("pore_water",), {"suction": -1.0, "retention": {"set": "fitted"}})
    yield "water through one axis", *add(("pore_water",), {"suction": 1.0, "anisotropy": [1.0]})
    yield "water across no layers", *add(("pore_water",), {"suction": 1.0, "anisotropy": [1.0, 0.0]})
    yield "a line of one point", *add(("pore_water",), {"phreatic_line": [[0.0, 0.0]]})
    yield "layers fall", *add(("bodies", 0, "layers"), [{"above": z, "material": body["material"]} for z in (1, 0)])
    yield "layer of nothing", *add(("bodies", 0, "layers"), [{"above": 0.0, "material": "air"}])
    yield "material of nothing", *add(("bodies", 0, "material"), "air")
    yield "shaken bits", *add(("bodies", 0, "jitter"), 0.31)
    for stress in ({"type": "geostatic", "K0": -1}, {"type": "uniform"}, {"type": "uniform", "components": {"zx": 1}}):
        yield f"initial {stress}", *add(("initial_stress",), stress)
    if "initial_stress" in data:
        for gravity in (None, [0.0] * d):
            yield "geostatic without gravity", *add(("gravity",), gravity)
    yield from wrong_boundaries(data)
    yield from wrong_contacts(data)
    yield from wrong_stages(data)
    yield from wrong_laws(data)


def wrong_shapes(d):
    """(what, shape) of shapes without an inside, or of another dimension."""
    z = {} if d == 2 else {"extrude": [0, 1]}
    yield "upside down", {"type": "box", "lower": [1.0] * d, "upper": [0.0] * d}
    yield "flat box", {"type": "box", "lower": [0.0] * d, "upper": [1.0] * (d - 1) + [0.0]}
    yield "box of one corner", {"type": "box", "lower": [0.0] * d}
    yield "polygon on a line", {"type": "polygon", "vertices": [[0, 0], [1, 1], [2, 2]], **z}
    yield "polygon of two corners", {"type": "polygon", "vertices": [[0, 0], [1, 1]], **z}
    yield "polygon of one point", {"type": "polygon", "vertices": [[1, 1]] * 5, **z}
    yield "polygon of many corners", {"type": "polygon", "vertices": [[i, i * i] for i in range(10_001)], **z}
    yield "round of no size", {"type": "disc" if d == 2 else "sphere", "center": [0.0] * d, "radius": 0}
    yield "round of another dimension", {"type": "sphere" if d == 2 else "disc", "center": [0.0] * d, "radius": 1.0}
    yield "thin as air", {"type": "box", "lower": [0.0] * d, "upper": [1e-9] * d}
    yield "as large as the world", {"type": "box", "lower": [-1e7] * d, "upper": [1e7] * d}


def wrong_boundaries(data):
    """Boundary conditions of no kind, of two, on nothing, or in no direction."""
    d = data["dimension"]
    everywhere = {"lower": [None] * d, "upper": [1e6] * d}
    stages = [stage | {"boundaries": ["bad"]} for stage in data["stages"]]
    beyond = {"x": 1.0, "y": 1.0, "z": 1.0} if d == 2 else {"w": 1.0}
    conditions = {
        "no kind": {"where": everywhere},
        "two kinds": {"where": everywhere, "fix": ["x"], "velocity": {"x": 1.0}},
        "no place": {"fix": ["x"]},
        "any place": {"where": {}, "fix": ["x"]},
        "upside down": {"where": {"lower": [1.0] * d, "upper": [0.0] * d}, "fix": ["x"]},
        "on nothing": {"where": {"lower": [5e5] * d}, "fix": ["x"]},
        "on no body": {"where": {"body": "ghost"}, "fix": ["x"]},
        "held twice": {"where": everywhere, "fix": ["x", "x"]},
        "held in no direction": {"where": everywhere, "fix": []},
        "held along w": {"where": everywhere, "fix": ["w"]},
        "moved beyond": {"where": everywhere, "velocity": beyond},
        "moved along nothing": {"where": everywhere, "velocity": {}},
        "jumps": {"where": everywhere, "displacement": {"x": 1.0}},
        "no history": {"where": everywhere, "displacement": {"x": {"times": [], "values": []}}},
        "unequal history": {"where": everywhere, "displacement": {"x": {"times": [0, 1], "values": [0]}}},
        "back in time": {"where": everywhere, "displacement": {"x": {"times": [0, 1, 1], "values": [0, 1, 2]}}},
        "load on no side": {"where": everywhere, "traction": {"stress": [0.0] * d, "side": "top"}},
        "load of another dimension": {"where": everywhere, "traction": {"stress": [0.0] * (5 - d), "side": "x+"}},
    }  # fmt: skip
    for what, condition in conditions.items():
        scene = copy.deepcopy(data) | {"boundaries": {"bad": condition}, "stages": stages}
        yield f"boundary: {what}", ("boundaries", "bad"), scene
    path = ("boundaries",)
    for name in ("../x", "", " ", "a\nb", "x" * 65):
        yield f"boundary named {name!r:.10}", path, edited(data, path, lambda p, k, n=name: p.update({k: {n: {}}}))


def wrong_contacts(data):
    """Contacts with what is not there, in no direction, of a kind of another dimension."""
    d = data["dimension"]
    plane = {"type": "plane", "point": [0.0] * d, "normal": [0.0] * (d - 1) + [1.0], "friction": 0.5}
    body = data["bodies"][0]["name"]
    contacts = {
        "no direction": plane | {"normal": [0.0] * d},
        "other dimension": plane | {"normal": [0.0] * (5 - d)},
        "negative friction": plane | {"friction": -0.1},
        "damping above critical": plane | {"damping": 1.1},
        "no stiffness": plane | {"stiffness": 0},
        "huge stiffness": plane | {"stiffness": 1e21},
        "no stage": plane | {"stages": []},
        "unknown stage": plane | {"stages": ["never"]},
        "box upside down": {"type": "box", "lower": [1.0] * d, "upper": [0.0] * d, "friction": 0},
        "body with itself": {"type": "bodies", "first": body, "second": body, "friction": 0},
        "body with a ghost": {"type": "bodies", "first": body, "second": "ghost", "friction": 0},
        "ground of one point": {"type": "polyline", "vertices": [[0, 0], [0, 0]], "friction": 0},
        "of no kind": plane | {"type": "glue"},
        "faster than a bullet": plane | {"velocity": [1e6] * d},
    }  # fmt: skip
    for what, contact in contacts.items():
        others = data.get("contacts", [])
        yield f"contact: {what}", ("contacts", len(others)), copy.deepcopy(data) | {"contacts": [*others, contact]}
    yield "contacts by name", ("contacts",), copy.deepcopy(data) | {"contacts": {"floor": plane}}


def wrong_stages(data):
    """Stages that never end, have no name of their own, or use what is not there."""
    first, count = data["stages"][0], len(data["stages"])
    stages = {
        "of no kind": {"name": "x", "type": "wait"},
        "without end": {"name": "x", "type": "dynamics"},
        "backwards": {"name": "x", "type": "dynamics", "duration": -1.0},
        "without time": {"name": "x", "type": "dynamics", "duration": 0},
        "longer than life": {"name": "x", "type": "dynamics", "duration": 1e10},
        "at rest at once": {"name": "x", "type": "dynamics", "duration": 1.0, "stop_when_at_rest": 1.0},
        "with a ghost": {"name": "x", "type": "dynamics", "duration": 1.0, "boundaries": ["ghost"]},
        "of another kind": {"name": "x", "type": "relax", "duration": 1.0},
        "as exact as nothing": {"name": "x", "type": "relax", "tolerance": 1e-15},
        "without steps": {"name": "x", "type": "relax", "max_steps": 0},
        "of half a step": {"name": "x", "type": "relax", "max_steps": 0.5},
        "undamped": {"name": "x", "type": "dynamics", "duration": 1.0, "damping": {"viscous": -1.0}},
        "twice": first,
        "nameless": {k: v for k, v in first.items() if k != "name"},
    }  # fmt: skip
    for what, stage in stages.items():
        yield f"stage {what}", ("stages", count), copy.deepcopy(data) | {"stages": [*data["stages"], stage]}
    yield "no stage", ("stages",), copy.deepcopy(data) | {"stages": []}


def wrong_laws(data):
    """Materials whose parameters contradict each other, or that are not there."""
    name, law = next((n, m) for n, m in data["materials"].items())
    pairs = {
        "cam_clay": [{"swelling_index": 0.9}, {"porosity": 1.0}, {"overconsolidation_ratio": 0.9}],
        "arena": [{"FSLOPE": 0.1, "YSLOPE": 0.2}, {"CR": 1.5}, {"initial_porosity": 1.0}, {"initial_saturation": 1.1}],
        "drucker_prager": [{"friction_angle": 90.0}, {"cohesion": -1.0}, {"friction_angle": -1.0}],
        "elastic": [{"bulk_modulus": -1e9}, {"shear_modulus": -1.0}],
        "granular_mu_i": [{"inertial_number": 0.0}, {"static_friction": 3.0}, {"density": 0.0}],
        "mohr_coulomb": [{"friction_angle": 90.0}, {"dilation_angle": 20.0}, {"sensitivity": 0.5}],
    }
    for key, entry in data["materials"].items():
        for change in pairs[entry["model"]]:
            path = ("materials", key, next(iter(change)))
            yield f"law {change}", path, changed(data, ("materials", key), entry | change)
    for model in ("no_such_law", "", "os.system", "../elastic", "Elastic", "elastic\n", None, 3, ["elastic"]):
        yield f"law {model!r}", ("materials", name, "model"), changed(data, ("materials", name), law | {"model": model})
    for bad in ("../x", "", "a/b", "\u202e", "x" * 65):
        yield f"law named {bad!r:.10}", ("materials",), changed(data, ("materials",), data["materials"] | {bad: law})


def paths(data):
    """Names of result files that lead elsewhere."""
    base = {"output": {}} | data
    for name in FILES:
        yield f"file {name!r:.20}", ("output", "file"), changed(base, ("output", "file"), name)


def dumped(scene):
    """The YAML text of a scene."""
    return yaml.dump(scene, Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True)


def texts(data):
    """(what, bytes) of files whose damage lies below the data."""
    good = dumped(data)
    laughs = "a0: &a0 [ha, ha, ha, ha, ha, ha, ha, ha, ha]\n"
    laughs += "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))
    additions = {
        "billion laughs": laughs,
        "quadratic laughs": "a: &a " + "x" * 1000 + "\nb: [" + ", ".join(["*a"] * 20_000) + "]\n",
        "alias of itself": "a: &a [*a]\n",
        "alias of its parent": "a: &a {b: {c: *a}}\n",
        "alias of nothing": "a: *nothing\n",
        "alias as key": "a: &a x\n*a : 1\n",
        "list as key": "[1, 2]: 3\n",
        "merge key": "a: &a {x: 1}\n<<: *a\n",
        "python object": "a: !!python/object/apply:os.system ['touch pwned']\n",
        "local tag": "a: !include /etc/passwd\n",
        "binary tag": "a: !!binary aGVsbG8=\n",
        "second document": "---\nspacing: 1\n",
        "spacing twice": f"spacing: {data['spacing']}\n",
        "deep list": "a: " + "[" * 5000 + "]" * 5000 + "\n",
        "deep mapping": "a: " + "{b: " * 5000 + "}" * 5000 + "\n",
        "long key": "k" * 100_000 + ": 1\n",
        "long number": "seed: " + "9" * 10_000 + "\n",
        "many keys": "".join(f"key{k}: {k}\n" for k in range(5000)),
        "tab": "output:\n\tinterval: 1\n",
        "open bracket": "a: [1, 2\n",
        "open quote": 'a: "x\n',
        "NUL": "a: x\0y\n",
        "escape": "a: \x1b[2J\n",
        "null key": "~: 1\n",
        "question": "? {a: 1}\n: 2\n",
        "percent": "%YAML 9.9\n---\n",
    }
    for what, text in additions.items():
        yield what, (good + text).encode()
    yield "nothing", b""
    yield "only a comment", b"# nothing\n"
    yield "null", b"~\n"
    yield "list", b"- " + good.replace("\n", "\n  ").encode()
    yield "text", b"hello\n"
    yield "number", b"42\n"
    yield "UTF-16", good.encode("utf-16")
    yield "Latin-1", (good + "a: Böschung\n").encode("latin-1")
    yield "zeros", bytes(1000)
    yield "half a character", good.encode() + b"a: \xc3\n"
    yield "too large", good.encode() + b"# " + b"x" * 5_000_001
    yield "JSON with a comma", b'{"dimension": 2,, "spacing": 1}'
    for end in range(0, len(good) // 2, max(1, len(good) // 40)):
        yield f"cut after {end}", good[:end].encode()
