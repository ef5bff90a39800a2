"""The verification cases: each a function of (full, scheme) that returns its figures."""

from dataclasses import dataclass

from . import (
    biaxial,
    buckling,
    clay_flow,
    closed_forms,
    collapse,
    columns,
    consolidation,
    contacts,
    drainage,
    energy,
    footing,
    hole,
    kinematics,
    manufactured,
    motion,
    noise,
    rain,
    seepage,
    sliding,
    slopes,
    surfaces,
    waves,
)
from .common import DEFAULT, Figure

OPTIONS = {
    "point_state, sharpened": DEFAULT,
    "bond_projected, points": {"scheme": "bond_projected", "dilatation": "points"},
    "bond_projected, balance": {"scheme": "bond_projected", "balance": True},
    "point_state, sharpened, balance": {"scheme": "point_state", "sharpened": True, "balance": True},
}  # names of schemes with options
SCHEMES = (
    "point_state, sharpened", "point_state", "bond_projected", "sub_horizon", "standard", "sub_horizon_published",
)  # fmt: skip

BALANCED = ("point_state, sharpened, balance", "bond_projected, balance")


@dataclass(frozen=True)
class Case:
    """A row of the table; its first docstring line says what it is."""

    name: str
    function: callable
    schemes: tuple[str, ...] = SCHEMES[:1]

    def run(self, full: bool, scheme: str) -> list[Figure]:
        """The figures, at full or at small size."""
        return self.function(full=full, scheme=OPTIONS.get(scheme, scheme))

    @property
    def what(self) -> str:
        """What is compared."""
        return self.function.__doc__.splitlines()[0].partition(": ")[2].rstrip(".")


CASES = (
    Case("V1", kinematics.affine_velocity, SCHEMES),
    Case("V2", kinematics.rigid_turns, SCHEMES),
    Case("V2", motion.spinning_disc),
    Case("V2", motion.tumbling_block),
    Case("V3", motion.spectrum),
    Case("V3", motion.stability),
    Case("V4", energy.ledger),
    Case("V4", energy.virtual_power, (*SCHEMES[:5], *BALANCED)),
    Case("V4", energy.stress_work),
    Case("V5", waves.wave_speed),
    Case("V6", manufactured.manufactured),
    Case("V6", manufactured.in_balance, BALANCED),
    Case("V7", columns.self_weight),
    Case("V8", columns.sudden_weight),
    Case("V9", motion.cantilever),
    Case("V9", motion.swinging_beam),
    Case("V10", kinematics.simple_shear),
    Case("V11", closed_forms.isotropic_compaction),
    Case("V12", closed_forms.constant_pressure_shear),
    Case("V13", closed_forms.undrained_critical_state),
    Case("V14", closed_forms.oedometer),
    Case("V23", buckling.column),
    Case("V24", buckling.post_buckling),
    Case("V26", hole.hole_in_a_plate),
    Case("V15", sliding.incline),
    Case("V15", sliding.sticking),
    Case("V15", sliding.stopping),
    Case("V15", sliding.published_friction),
    Case("V20", footing.strip_footing),
    Case("V21", slopes.vertical_cut),
    Case("V21", slopes.sand_slope),
    Case("V22", surfaces.uniform_stress, SCHEMES[:5]),
    Case("V22", surfaces.displaced_points, BALANCED),
    Case("V22", surfaces.resting_column),
    Case("V22", surfaces.strip_load),
    Case("V22", surfaces.pushed_footing),
    Case("V25", biaxial.bands),
    Case("V27", clay_flow.flow_round_a_bar),
    Case("V28", clay_flow.cavity),
    Case("collapse", collapse.collapse),
    Case("C1", contacts.waves_through_contact),
    Case("C2", contacts.line_contact),
    Case("C2", contacts.line_contact_on_a_plane),
    Case("C3", contacts.platens),
    Case("C4", contacts.torsion),
    Case("C5", contacts.moving_walls),
    Case("W1", seepage.consolidation),
    Case("W1", consolidation.one_way),
    Case("W2", consolidation.large_strain),
    Case("W3", consolidation.slab),
    Case("W4", consolidation.sphere),
    Case("W5", seepage.infiltration),
    Case("W6", drainage.ponded),
    Case("W7", drainage.liakopoulos),
    Case("W8", footing.undrained_footing),
    Case("W9", waves.undrained_wave),
    Case("W10", slopes.wet_slope),
    Case("W11", noise.at_rest_and_in_flow),
    Case("W12", rain.failure_by_rain),
)
