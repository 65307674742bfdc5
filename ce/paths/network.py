"""A committor learned from paths: hazards of the others of a state added up, each from a small network.

    log L_b(state) = mean over the networks of log sum over the others j of exp z(features_j, b)

z is a network of two hidden layers whose activation is the rational x (27 + x^2) / (27 + 9 x^2), cut at +-1, close
to tanh.
All of it is arithmetic with the same bits on every processor (`exactly`), and a row's result depends on nothing but
the row.
"""

import hashlib

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.codec import to_bytes
from ce.errors import ResponseError, StateError
from ce.paths import exactly

Array = NDArray[np.float64]

# Standardised features, and levels as the network has them, are cut there.
LARGEST_FEATURE, LARGEST_LEVEL = 8.0, 2.0
# log hazard of one of the others, at least and at most.
LEAST, MOST = -25.0, 1.0
# Multiples of 2^-bits that features, activations and weights are rounded to, so that sums of products are exact.
FEATURE_BITS, ACTIVATION_BITS, WEIGHT_BITS = 16, 20, 18
LARGEST_WEIGHT = 32.0
# Rows that are looked at at a time.
ROWS = 200


class Net(msgspec.Struct, frozen=True, eq=False):
    """One network.

    w1: (F + 1, h), the last row of the level
    b1: (h,)
    w2: (h, h)
    b2: (h,)
    w3: (h, 1)
    b3: (1,)
    """

    w1: Array
    b1: Array
    w2: Array
    b2: Array
    w3: Array
    b3: Array

    def arrays(self) -> tuple[Array, ...]:
        """All of its arrays."""
        return self.w1, self.b1, self.w2, self.b2, self.w3, self.b3

    def rounded(self) -> "Net":
        """Its weights as they are used."""
        return Net(
            *(
                exactly.rounded(np.clip(a, -LARGEST_WEIGHT, LARGEST_WEIGHT), WEIGHT_BITS)
                for a in self.arrays()
            )
        )


class NetworkCommittor(msgspec.Struct, frozen=True, eq=False):
    """A learned committor as plain arrays.

    center: (F,), of each feature
    scale: (F,), what each feature is divided by
    level_low: level that the networks have as -1, in the unit of the measure
    level_high: level that they have as 1
    nets: whose predictions are averaged in their logarithm
    """

    center: Array
    scale: Array
    level_low: float
    level_high: float
    nets: tuple[Net, ...]

    def standardised(self, features: NDArray[np.float32]) -> Array:
        """Features (..., F) as the networks have them; ResponseError for another number of features."""
        if features.shape[-1] != self.center.size:
            raise ResponseError(
                f"the committor was trained on {self.center.size} features, the process gives "
                f"{features.shape[-1]}; train another one"
            )
        z = features.astype(np.float64)
        z -= self.center
        z /= self.scale
        np.clip(z, -LARGEST_FEATURE, LARGEST_FEATURE, out=z)
        return exactly.rounded(z, FEATURE_BITS, out=z)

    def encoded(self, levels: Array) -> Array:
        """Levels as the networks have them."""
        middle, half = 0.5 * (self.level_low + self.level_high), 0.5 * (self.level_high - self.level_low)
        scaled = np.clip((levels - middle) / half, -LARGEST_LEVEL, LARGEST_LEVEL)
        return exactly.rounded(scaled, FEATURE_BITS)

    def log_hazard(self, features: NDArray[np.float32], levels: Array) -> Array:
        """log of the predicted number (n, L) of times that a state with features (n, m, F) comes to each level."""
        levels = self.encoded(np.asarray(levels, dtype=np.float64))
        nets = [net.rounded() for net in self.nets]
        out = np.empty((features.shape[0], levels.size))
        for at in range(0, features.shape[0], ROWS):
            x = self.standardised(features[at : at + ROWS])
            n, m, width = x.shape
            flat, total = x.reshape(n * m, width), np.zeros((levels.size, n))
            z = np.empty((levels.size, n * m))
            for net in nets:
                first = flat @ net.w1[:-1]
                for j, level in enumerate(levels):
                    z[j] = _output(net, first + (net.b1 + level * net.w1[-1]))
                each = exactly.exp(z).reshape(levels.size, n, m)
                total += exactly.log(exactly.added(np.moveaxis(each, 2, 0)))
            out[at : at + n] = total.T / len(nets)
        return out

    @property
    def checksum(self) -> str:
        """SHA-256 over all numbers, in hexadecimal."""
        return hashlib.sha256(to_bytes(self)).hexdigest()


class _Saved(msgspec.Struct, frozen=True, eq=False):
    committor: NetworkCommittor
    checksum: str
    format: int = 1


def saved(committor: NetworkCommittor) -> bytes:
    """The committor as MessagePack: plain arrays and a checksum."""
    return to_bytes(_Saved(committor, committor.checksum))


def loaded(data: bytes) -> NetworkCommittor:
    """The committor that `saved` wrote; StateError for other or damaged bytes."""
    try:
        found = msgspec.msgpack.decode(data, type=_Saved, dec_hook=_array)
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError) as error:
        raise StateError(f"these bytes are not a saved committor: {error}") from None
    if found.format != 1:
        raise StateError(f"the committor has format {found.format}, this version reads 1")
    if found.committor.checksum != found.checksum:
        raise StateError(
            "the committor's checksum does not fit its numbers: the file is damaged; save it again"
        )
    return found.committor


def _array(kind: type, value: dict[str, object]) -> Array:
    data, dtype, shape = value["data"], value["dtype"], value["shape"]
    if not isinstance(data, bytes) or dtype != "<f8" or not isinstance(shape, list | tuple):
        raise ValueError("an array of float64 was expected")
    return np.frombuffer(data, dtype="<f8").reshape([int(k) for k in shape]).astype(np.float64)


def activation(x: Array, out: Array | None = None) -> Array:
    """x (27 + x^2) / (27 + 9 x^2), +-1 beyond +-3; `out` may be x itself."""
    out = np.clip(x, -3.0, 3.0, out=out)
    square = out * out
    out *= square + 27.0
    square *= 9.0
    square += 27.0
    out /= square
    return out


def slope(x: Array) -> Array:
    """Derivative of `activation`: ((9 - x^2) / (9 + 3 x^2))^2, 0 beyond +-3."""
    square = x * x
    np.minimum(square, 9.0, out=square)
    root = 9.0 - square
    square *= 3.0
    square += 9.0
    root /= square
    root *= root
    return root


def _output(net: Net, before: Array) -> Array:
    """z (rows,) from what goes into the first activation (rows, h), which is written over."""
    hidden = exactly.rounded(activation(before, out=before), ACTIVATION_BITS, out=before) @ net.w2
    hidden += net.b2
    hidden = exactly.rounded(activation(hidden, out=hidden), ACTIVATION_BITS, out=hidden)
    return np.clip((hidden @ net.w3 + net.b3)[:, 0], LEAST, MOST)
