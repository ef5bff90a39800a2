"""Stages: what a scene may say of what happens, one after the other."""

from typing import Annotated, Literal

from pydantic import Field

from periporo.io.schema.base import Flag, Integer, Motion, Name, Real, Region, SceneModel, key


class Change(Region):
    """Points that become another material, with the stress that they have."""

    into: Name = key("name of the material that they become")


class _Stage(SceneModel):
    """What every stage has."""

    name: Name = key("name of the stage")
    remove: tuple[Region, ...] = key(
        "what is dug away when it begins: the points that lay in any of these regions at the start", default=(),
        max_length=1000,
    )
    place: tuple[Name, ...] = key("bodies that come when it begins, without stress", default=(), max_length=1000)
    change: tuple[Change, ...] = key(
        "points, as they lay at the start, that become another material when it begins", default=(), max_length=1000
    )
    gravity_factor: Motion | None = key(
        "what gravity is multiplied by: a number, {times, values} or {file}; default 1", "1", default=None
    )


class RelaxStage(_Stage):
    """Quasi-static relaxation to equilibrium."""

    type: Literal["relax"] = key("kind of stage")
    tolerance: Real = key(
        "out-of-balance force over load at which it ends", "1", default=1e-4, ge=1e-14, le=0.1
    )
    max_steps: Integer = key(
        "steps after which it is given up; earlier if what is out of balance has not become less for 20000 steps",
        default=200_000, ge=1, le=10**9,
    )  # fmt: skip
    max_displacement: Real = key(
        "way of a point, over the shortest side of its body, beyond which it flows and the run ends", "1",
        default=0.1, gt=0, le=1e6,
    )
    reset_displacement: Flag = key("count displacements from its end", default=False)
    boundaries: tuple[Name, ...] = key("boundary conditions in force", default=())


class ViscousDamping(SceneModel):
    """Damping in proportion to mass and velocity."""

    viscous: Real = key("rate at which free motion decays", "1/s", default=0.0, ge=0, le=1e9)
    relative_to: Name | None = key(
        "boundary whose points' mean velocity it leaves alone: a base that is shaken; default what stands", default=None
    )


class DynamicsStage(_Stage):
    """Motion in real time."""

    type: Literal["dynamics"] = key("kind of stage")
    duration: Real = key("duration", "s", gt=0, le=1e9)
    boundaries: tuple[Name, ...] = key("boundary conditions in force", default=())
    damping: ViscousDamping = key("damping of the motion", default=ViscousDamping())
    stop_when_at_rest: Real | None = key(
        "end early when the kinetic energy falls to this fraction of its peak", "1", default=None, gt=0, lt=1
    )


class QuasiStaticStage(_Stage):
    """Hours or days in which water flows while the soil stays in equilibrium, in increments of physical time.

    It ends early where no equilibrium is found any more; what follows begins at that time. Boundaries that move stand
    still.
    """

    type: Literal["quasi_static"] = key("kind of stage")
    duration: Real = key("duration", "s", gt=0, le=1e12)
    accuracy: Real = key(
        "error of the pressure in an increment, over the largest pressure, by which its length is chosen", "1",
        default=0.02, ge=1e-6, le=0.5,
    )
    tolerance: Real = key(
        "out-of-balance force over load up to which it is equilibrium", "1", default=1e-4, ge=1e-14, le=0.1
    )
    max_steps: Integer = key(
        "steps in search of equilibrium, in an increment, after which it is lost", default=10_000, ge=1, le=10**9
    )
    boundaries: tuple[Name, ...] = key("boundary conditions in force", default=())


class StrengthReductionStage(_Stage):
    """Trials with weaker and weaker soil that look for the factor of safety; its results show the failure.

    All trials begin with the state in which the stage begins. Cohesion and tan(phi) are divided by the factor, of every
    law that says how; laws without strength stay as they are.
    """

    type: Literal["strength_reduction"] = key("kind of stage")
    trial: Real = key("duration of a trial", "s", gt=0, le=1e9)
    damping: ViscousDamping = key("damping of the motion; it needs some to come to rest")
    moving: Real = key(
        "speed that tells failure at the end of a trial, over that of free fall, gravity over viscous damping", "1",
        default=1e-3, gt=0, lt=1,
    )
    accuracy: Real = key("width of the bracket of the factor, over the factor", "1", default=0.02, gt=0, lt=1)
    largest: Real = key("largest factor that is tried", "1", default=5.0, gt=1, le=1e3)
    boundaries: tuple[Name, ...] = key("boundary conditions in force", default=())


STILL = ("relax", "quasi_static")
"""Stages in which what is prescribed stands still."""

Stage = Annotated[
    RelaxStage | DynamicsStage | QuasiStaticStage | StrengthReductionStage, Field(discriminator="type")
]
