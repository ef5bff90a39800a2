"""What can be wrong with a law: one error for each clause of the contract."""


class NonConformance(AssertionError):
    """The law breaks the contract; the message says where and how to fix it."""


class DeclarationError(NonConformance):
    """`density` or `state_fields` is not what the protocol asks for."""


class ShapeError(NonConformance):
    """An array has the wrong shape or type, or a method changes what it must leave alone."""


class ModuliError(NonConformance):
    """`elastic_moduli` are not positive, finite (n,) arrays, or not those of the response."""


class ZeroIncrementError(NonConformance):
    """Stress changes although nothing was strained (and no time passed)."""


class FrameError(NonConformance):
    """The response depends on the orientation of the axes, or takes components for each other."""


class RefusalError(NonConformance):
    """A step is refused that must not be, or again and again."""


class SplitError(NonConformance):
    """The result of a row depends on the other rows in the call."""


class NonFiniteError(NonConformance):
    """NaN or infinity after finite strains, or in rows without state."""


class OpeningError(NonConformance):
    """A row that has come apart bears something before it has closed, or does not close again."""


class CycleEnergyError(NonConformance):
    """A law that declares itself `conservative` made or lost energy in a closed cycle of strain."""
