"""Elastic, perfectly plastic Mohr-Coulomb soil, returned in principal stresses; NumPy only."""

from dataclasses import dataclass

import numpy as np

from periporo.materials import OPENED, from_matrix, to_matrix


@dataclass(frozen=True)
class MohrCoulomb:
    """s1 - s3 + (s1 + s3) sin(phi) <= 2 c cos(phi) for s1 >= s2 >= s3, tension positive; flow with psi."""

    density: float
    bulk_modulus: float
    shear_modulus: float
    cohesion: float
    friction_angle: float
    dilation_angle: float = 0.0
    state_fields = (OPENED,)  # the program writes it: what a row expands beyond `tension_limit`

    def __post_init__(self):
        if not 0 < self.friction_angle < 90 or not 0 <= self.dilation_angle <= self.friction_angle:
            raise ValueError("angles must satisfy 0 < friction_angle < 90, dilation_angle <= friction_angle")

    @classmethod
    def example(cls):
        return cls(1700.0, 25e6, 15e6, 1e3, 30.0, 10.0)

    def initial_state(self, stress, ids, volume):
        return np.zeros((len(stress), 1))

    def tension_limit(self, stress, state):
        return np.full(len(stress), self.cohesion / np.tan(np.radians(self.friction_angle)))

    def elastic_moduli(self, stress, state):
        return np.full(len(stress), self.bulk_modulus), np.full(len(stress), self.shear_modulus)

    def plane(self, angle, high, low):
        """Gradient of the plane in which `high` and `low` are the extreme principal stresses."""
        gradient = np.zeros(3)
        gradient[high], gradient[low] = 1 + np.sin(np.radians(angle)), np.sin(np.radians(angle)) - 1
        return gradient

    def return_maps(self):
        """2 c cos(phi), the apex, and n, a of face and edges: s = trial - a (n trial - 2 c cos(phi))."""
        stiffness = self.bulk_modulus - 2 / 3 * self.shear_modulus + 2 * self.shear_modulus * np.eye(3)
        maps = []
        for planes in ([(0, 2)], [(0, 2), (0, 1)], [(0, 2), (1, 2)]):  # face, edges s2 = s3 and s1 = s2
            normals = np.array([self.plane(self.friction_angle, *p) for p in planes])
            flow = stiffness @ np.array([self.plane(self.dilation_angle, *p) for p in planes]).T
            maps.append((normals, flow @ np.linalg.inv(normals @ flow)))
        phi = np.radians(self.friction_angle)
        return 2 * self.cohesion * np.cos(phi), self.cohesion / np.tan(phi), maps

    def compute_stress(self, stress, strain_increment, state, dt):
        volumetric = strain_increment[:, :3].sum(axis=1, keepdims=True)
        stress += 2 * self.shear_modulus * strain_increment
        stress[:, :3] += (self.bulk_modulus - 2 / 3 * self.shear_modulus) * volumetric
        strength, apex, maps = self.return_maps()
        values, vectors = np.linalg.eigh(to_matrix(stress))
        values, vectors = values[:, ::-1], vectors[:, :, ::-1]  # descending
        fails = np.einsum("i,ni->n", maps[0][0][0], values) > strength
        face, right, left = (
            values - np.einsum("ik,nk->ni", a, np.einsum("ki,ni->nk", n, values) - strength) for n, a in maps
        )
        psi = np.sin(np.radians(self.dilation_angle))  # s2 and s3 meet before s1 and s2 do:
        to_right = (1 - psi) * values[:, 0] + (1 + psi) * values[:, 2] > 2 * values[:, 1]
        result = np.full_like(values, apex)
        for returned, valid in (
            (left, ~to_right & (left[:, 1] >= left[:, 2])),
            (right, to_right & (right[:, 0] >= right[:, 1])),
            (face, (face[:, 0] >= face[:, 1]) & (face[:, 1] >= face[:, 2])),
        ):
            result[valid] = returned[valid]
        rebuilt = np.einsum("nik,nk,njk->nij", vectors, result, vectors)
        stress[fails] = from_matrix(rebuilt, stress.shape[1])[fails]
