"""tanh without branches, so that the compiler works out several at once: np.tanh takes six times as long.

tanh |x| = m / (m + 2) with m = exp(2 |x|) - 1, which has all its digits where x is small. With 2 |x| = k ln 2 + r, k an
integer and |r| <= ln 2 / 2, m = 2^k p + 2^k - 1 where p = exp(r) - 1 is the Taylor polynomial of degree 13: its
remainder is below r 1.3e-17 (J.-M. Muller, "Elementary Functions", ch. 11, for the reduction and ln 2 in two parts).
"""

from __future__ import annotations

import math

import numba
import numpy as np

#: From here on 2 |x| is as good as infinite: tanh x rounds to 1 from x = 19.07 on.
_SATURATED = 40.0
#: Beside it numbers below 2^51 round to integers, which are the last bits of the sum.
_TO_INTEGER = 1.5 * 2.0**52
#: ln 2 in two parts: the first has so few digits that its product with k is exact.
_LN2_HIGH, _LN2_LOW = float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33")
_INVERSE_LN2 = 1.0 / math.log(2.0)
#: 1 / n! for n from 13 down to 2.
_TAYLOR = tuple(1.0 / math.factorial(n) for n in range(13, 1, -1))
#: Bits of a double's mantissa, and what its exponent is stored with.
_MANTISSA, _BIAS = np.int64(52), np.int64(1023)


def tanh(values: np.ndarray) -> np.ndarray:
    """tanh of an array of any shape, within 4 units in the last place; NaN stays NaN, and -0 is -0."""
    result = np.array(values, dtype=float, order="C")
    _tanh_in_place(result.reshape(-1))
    return result


# Division raises by default, and a loop that can raise is not vectorised.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def _tanh_in_place(values: np.ndarray) -> None:
    for i in range(len(values)):
        x = values[i]
        double = 2.0 * abs(x)
        # Not min: NaN has to stay.
        double = _SATURATED if double > _SATURATED else double
        shifted = double * _INVERSE_LN2 + _TO_INTEGER
        k = shifted - _TO_INTEGER
        r = (double - k * _LN2_HIGH) - k * _LN2_LOW
        series = 0.0
        for coefficient in _TAYLOR:
            series = series * r + coefficient
        p = r + r * r * series
        bits = (np.float64(shifted).view(np.int64) + _BIAS) << _MANTISSA
        power = np.int64(bits).view(np.float64)
        m = power * p + (power - 1.0)
        values[i] = math.copysign(m / (m + 2.0), x)
