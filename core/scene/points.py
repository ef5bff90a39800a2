"""The points of a scene's bodies, with all that they carry from the start."""

import numpy as np

from periporo.contact.faces import FACES, REACH, hat
from periporo.core.points.particles import RING
from periporo.core.scene.contacts import bonding_groups
from periporo.io.geometry.faces import find_faces
from periporo.io.geometry.lattice import CHUNK

_MADE = ("id", "position", "volume", "material", "body", "velocity")


class PointMaker:
    """Makes the migrating fields of bodies' points, piece by piece, so that no rank needs all of them.

    `materials` and `water` are those of the simulation; bodies whose numbers are `held` stand still at first;
    `fields` are the parameters that vary, if any do.
    """

    def __init__(self, scene, particles, materials, water, lattices, held, fields=None):
        self._scene, self._particles, self._water, self._lattices = scene, particles, water, lattices
        self._fields = fields
        self._density = np.array([m.density for m in materials])
        self._groups = bonding_groups(scene)
        self._held = held

    def part_of(self, comm, bodies) -> dict[str, np.ndarray]:
        """This rank's share of the `bodies` (numbers) by field; the first rebuild hands points to their owners."""
        pieces = []
        for number in bodies:
            size = self._lattices[number].size
            begin, end = (size * r // comm.size for r in (comm.rank, comm.rank + 1))
            pieces += [self._piece(number, k, min(k + CHUNK, end)) for k in range(begin, end, CHUNK)]
        return self._completed(pieces)

    def owned_by(self, domain, bodies) -> dict[str, np.ndarray]:
        """Those points of the `bodies` whose places belong to this rank."""
        pieces = []
        for number in bodies:
            size = self._lattices[number].size
            for start in range(0, size, CHUNK):
                piece = self._piece(number, start, min(start + CHUNK, size))
                mine = domain.owns(piece["position"])
                pieces.append({name: array[mine] for name, array in piece.items()})
        return self._completed(pieces)

    def _piece(self, number, start, stop):
        """The points among some sites of a body."""
        body = self._scene.bodies[number]
        ids, position, volume, material = self._lattices[number].sites(start, stop)
        velocity = np.zeros(self._scene.dimension) if number in self._held else self._scene.vector(body.velocity)
        made = (ids, position, volume, material, np.full(len(ids), number), np.tile(velocity, (len(ids), 1)))
        return dict(zip(_MADE, made, strict=True))

    def _completed(self, pieces):
        """The pieces together, with the fields that follow, all others zero."""
        p = self._particles
        empty = {f.name: np.zeros(0 if f.columns is None else (0, f.columns), f.dtype) for f in p.migrating()}
        owned = {name: np.concatenate([empty[name], *(piece[name] for piece in pieces)]) for name in _MADE}
        owned["group"] = self._groups[owned["body"]]
        if RING in p.fields:
            owned[RING] = 2.0 * np.pi * owned["position"][:, 0]
            owned["volume"] = owned["volume"] * owned[RING]
        owned["mass"] = owned["volume"] * self._density[owned["material"]]
        if self._fields is not None:
            self._fields.initial_fields(owned)
        if self._water is not None:
            self._water.initial_fields(owned)
        for field in p.migrating():
            shape = (len(owned["id"]),) if field.columns is None else (len(owned["id"]), field.columns)
            owned.setdefault(field.name, np.zeros(shape, field.dtype))
        if "face" in p.fields:
            owned["face"] = _faces(self._scene, owned)
        owned["dilation"] = np.ones(len(owned["id"]))
        owned["initial_position"] = owned["position"].copy()
        owned["reference_position"] = owned["position"].copy()
        return owned


def _faces(scene, owned):
    """What the points know of the faces of their bodies: see `periporo.contact.faces`."""
    d, h = scene.dimension, scene.spacing
    face = np.zeros((len(owned["id"]), 1 + FACES[d] * (1 + d)))
    for number, body in enumerate(scene.bodies):
        rows = owned["body"] == number
        depths, normals = find_faces(body.shape, owned["position"][rows], FACES[d], REACH * h)
        known = normals[:, 0].any(axis=1)
        depths[~known, 0] = 0.5 * h  # a ball
        share = np.where(known, hat(depths[:, 0], h), 1.0)
        each = np.concatenate([depths[..., None], normals], axis=2)
        face[rows] = np.column_stack([share, each.reshape(len(share), -1)])
    return face
