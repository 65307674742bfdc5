"""Elementary functions with the same bits on every processor.

They use only additions, multiplications, divisions and square roots in a fixed order, which IEEE 754 rounds
correctly everywhere; the C library's versions choose another instruction sequence on another processor. Errors
are a few units in the last place, measured in the tests.
"""

import math

import numpy as np

from policies.jit import kernel

# pi/2 and ln 2 as sums of parts with few bits, so that a small integer times the leading part is exact.
_HALF_PI_1 = 1.5707963109016418  # the upper 25 bits of pi/2
_HALF_PI_2 = 1.5893254712295857e-08  # the next 25 bits
_HALF_PI_3 = 6.123233995736766e-17
_LN2_HIGH = 0.6931471675634384  # the upper 26 bits of ln 2
_LN2_LOW = 1.2996506893889889e-08

_SIN = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(9))
_COS = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(10))
_EXP = tuple(1.0 / math.factorial(k) for k in range(15))
_ERFC = (
    -1.26551223, 1.00002368, 0.37409196, 0.09678418, -0.18628806, 0.27886807, -1.13520398, 1.48851587, -0.82215223,
    0.17087277,
)  # fmt: skip
_ATANH = tuple(1.0 / (2 * k + 1) for k in range(12))


@kernel
def sincos(angle: float) -> tuple[float, float]:
    """Sine and cosine of `angle` in radians, for |angle| up to about 1e6."""
    turns = math.floor(angle / (math.pi / 2) + 0.5)
    r = ((angle - turns * _HALF_PI_1) - turns * _HALF_PI_2) - turns * _HALF_PI_3
    r2 = r * r
    s = 0.0
    for k in range(8, -1, -1):
        s = s * r2 + _SIN[k]
    s = s * r
    c = 0.0
    for k in range(9, -1, -1):
        c = c * r2 + _COS[k]
    quadrant = int(turns) & 3
    if quadrant == 0:
        return s, c
    if quadrant == 1:
        return c, -s
    if quadrant == 2:
        return -s, -c
    return -c, s


@kernel
def exp(x: float) -> float:
    """e to the power x, for |x| below about 700."""
    k = math.floor(x / math.log(2.0) + 0.5)
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    y = 0.0
    for i in range(14, -1, -1):
        y = y * r + _EXP[i]
    return math.ldexp(y, int(k))


@kernel
def log(x: float) -> float:
    """Natural logarithm of x > 0."""
    mantissa, exponent = math.frexp(x)
    if mantissa < 0.7071067811865476:
        mantissa *= 2.0
        exponent -= 1
    s = (mantissa - 1.0) / (mantissa + 1.0)
    s2 = s * s
    y = 0.0
    for k in range(11, -1, -1):
        y = y * s2 + _ATANH[k]
    return exponent * _LN2_HIGH + (exponent * _LN2_LOW + 2.0 * s * y)


# Rational approximations of the inverse normal distribution function: Wichura (1988), algorithm AS 241, PPND16.
_CENTRE_NUM = (
    3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3, 1.3731693765509461125e4,
    4.5921953931549871457e4, 6.7265770927008700853e4, 3.3430575583588128105e4, 2.5090809287301226727e3,
)  # fmt: skip
_CENTRE_DEN = (
    1.0, 4.2313330701600911252e1, 6.8718700749205790830e2, 5.3941960214247511077e3,
    2.1213794301586595867e4, 3.9307895800092710610e4, 2.8729085735721942674e4, 5.2264952788528545610e3,
)  # fmt: skip
_TAIL_NUM = (
    1.42343711074968357734e0, 4.63033784615654529590e0, 5.76949722146069140550e0, 3.64784832476320460504e0,
    1.27045825245236838258e0, 2.41780725177450611770e-1, 2.27238449892691845833e-2, 7.74545014278341407640e-4,
)  # fmt: skip
_TAIL_DEN = (
    1.0, 2.05319162663775882187e0, 1.67638483018380384940e0, 6.89767334985100004550e-1,
    1.48103976427480074590e-1, 1.51986665636164571966e-2, 5.47593808499534494600e-4, 1.05075007164441684324e-9,
)  # fmt: skip
_FAR_NUM = (
    6.65790464350110377720e0, 5.46378491116411436990e0, 1.78482653991729133580e0, 2.96560571828504891230e-1,
    2.65321895265761230930e-2, 1.24266094738807843860e-3, 2.71155556874348757815e-5, 2.01033439929228813265e-7,
)  # fmt: skip
_FAR_DEN = (
    1.0, 5.99832206555887937690e-1, 1.36929880922735805310e-1, 1.48753612908506148525e-2,
    7.86869131145613259100e-4, 1.84631831751005468180e-5, 1.42151175831644588870e-7, 2.04426310338993978564e-15,
)  # fmt: skip


@kernel
def _ratio(num: tuple, den: tuple, r: float) -> float:
    a = 0.0
    b = 0.0
    for k in range(7, -1, -1):
        a = a * r + num[k]
        b = b * r + den[k]
    return a / b


@kernel
def normal_quantile(p: float) -> float:
    """The standard normal quantile of p in (0, 1)."""
    q = p - 0.5
    if abs(q) <= 0.425:
        return q * _ratio(_CENTRE_NUM, _CENTRE_DEN, 0.180625 - q * q)
    r = math.sqrt(-log(p if q < 0.0 else 1.0 - p))
    if r <= 5.0:
        z = _ratio(_TAIL_NUM, _TAIL_DEN, r - 1.6)
    else:
        z = _ratio(_FAR_NUM, _FAR_DEN, r - 5.0)
    return -z if q < 0.0 else z


@kernel
def normals_from_bits(bits: np.ndarray, out: np.ndarray) -> None:
    """Fill `out` (n,) with standard normals from 64 random bits each (`bits`: (n,) uint64)."""
    for i in range(bits.shape[0]):
        # the top 52 bits as the centre of one of 2^52 equal cells: never 0 or 1
        out[i] = normal_quantile((np.float64(bits[i] >> np.uint64(12)) + 0.5) * 2.220446049250313e-16)


@kernel
def normal_tail(z: float) -> float:
    """The probability that a standard normal exceeds z, to a relative error of about 1e-7.

    The complementary error function as t exp(-x^2 + polynomial(t)), t = 1 / (1 + x / 2), with the Chebyshev
    coefficients of Press et al., Numerical Recipes, section 6.2.
    """
    x = abs(z) * 0.7071067811865476
    t = 1.0 / (1.0 + 0.5 * x)
    y = 0.0
    for k in range(9, -1, -1):
        y = y * t + _ERFC[k]
    tail = 0.5 * t * exp(max(y - x * x, -700.0))
    return tail if z >= 0.0 else 1.0 - tail


@kernel
def arcsine(y: float) -> float:
    """The angle in radians whose sine is y, for |y| up to 0.95: Newton's method from the cubic."""
    angle = y + y * y * y / 6.0
    for _ in range(6):
        sine, cosine = sincos(angle)
        angle -= (sine - y) / cosine
    return angle
