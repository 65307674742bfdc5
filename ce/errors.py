"""The errors of this package.

    CeError (ValueError)
    ├── FamilyError      a distribution that is not one: parameters, shapes, covariance, values outside the support
    ├── OptionsError     an option outside its range, or an unknown method
    │   └── BudgetError  fewer rollouts than the method needs
    ├── ThresholdError   gamma is NaN or infinite
    ├── ResponseError    the values of f do not fit the batch they answer
    └── StateError       a state or a batch that belongs to another problem, method or moment

Every message says what was given, what was expected and what to do.
"""


class CeError(ValueError):
    """Root of the errors raised by `ce`."""


class FamilyError(CeError):
    """A distribution's parameters, or values handed to it, are not usable."""


class OptionsError(CeError):
    """An option is outside its range."""


class BudgetError(OptionsError):
    """The budget is below the least that the method can work with."""


class ThresholdError(CeError):
    """The event threshold gamma is not a finite number."""


class ResponseError(CeError):
    """f returned something that is not one number for each row of the batch."""


class StateError(CeError):
    """Bytes, state or batch do not belong to this algorithm at this moment."""
