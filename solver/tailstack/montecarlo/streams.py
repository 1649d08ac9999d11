"""Random numbers of a trial from (seed, trial) alone, eight trials at a time.

Each trial owns two xoshiro256++ generators (Blackman and Vigna 2021), one for what is drawn once per
installed unit and one for what is drawn at every shot.  Their 256-bit states come from SplitMix64 of
(seed, stream, index), as the authors of xoshiro advise for seeding.  Why that is enough: xoshiro256++
passes BigCrush; a trial uses some 10^2 to 10^3 of its 2^256 words, so two of 10^9 trials overlap with
probability below 1e-50; SplitMix64 is a bijection followed by an avalanche, so neighbouring indices start from
unrelated states.  A counter-based Philox4x32-10 would serve as well and costs five times the integer
work per word.

Normals are Box-Muller pairs from 52-bit uniforms: radius up to 8.49, angle from an eighth of the circle
and two further bits.  Order: each run of columns with one law and stream (``plan._segments``) is drawn left to
right; normals in pairs (an odd run drops the last half), of other laws one word for each part (``laws.PARTS``).

log, sine and cosine are computed in lanes, without a maths library: polynomials of the usual kind (Cody-Waite
reduction, the minimax coefficients of fdlibm), written with explicit fused multiply-adds: libm differs in its last
digit between machines, these do not.
"""

from __future__ import annotations

import numpy as np

from ..laws import PARTS, SUMS
from .lanes import (
    as_bits,
    as_lanes,
    bits_set,
    fma,
    lane_entry,
    lane_jit,
    load,
    select,
    splat,
    splat_bits,
    square_root,
    store,
)

# mypy: ignore-errors


_MASK64 = (1 << 64) - 1
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_ONE = np.uint64(0x3FF0000000000000)  # pattern of 1.0
_B1, _B12, _B17, _B19, _B23, _B27, _B30, _B31, _B41, _B45, _B52, _B62, _B63 = (
    np.uint64(k) for k in (1, 12, 17, 19, 23, 27, 30, 31, 41, 45, 52, 62, 63)
)
_SIGN = np.uint64(1 << 63)
_WIDTHS = 2.0 * np.array([PARTS[law] for law in SUMS])  # (laws, 2): whole widths of the parts


def _mix_int(z: int) -> int:
    z = ((z ^ (z >> 30)) * int(_MIX1)) & _MASK64
    z = ((z ^ (z >> 27)) * int(_MIX2)) & _MASK64
    return z ^ (z >> 31)


def stream_key(seed: int, stream: int) -> np.uint64:
    """64-bit key of one stream of one seed; seeds of any size are folded in, 64 bits at a time."""
    key = _mix_int(0x7461696C737461 + stream)
    remaining = seed
    while True:
        key = _mix_int((key + (remaining & _MASK64) + int(_GOLDEN)) & _MASK64)
        remaining >>= 64
        if not remaining:
            return np.uint64(key)


@lane_jit
def _mix(z):
    z = (z ^ (z >> splat_bits(_B30))) * splat_bits(_MIX1)
    z = (z ^ (z >> splat_bits(_B27))) * splat_bits(_MIX2)
    return z ^ (z >> splat_bits(_B31))


@lane_jit
def seed_states(key, index):
    """Four state words of each lane from the key and the lane's index (SplitMix64)."""
    step = splat_bits(_GOLDEN)
    base = _mix(splat_bits(key) + index * step)
    a = base + step
    b = a + step
    c = b + step
    return _mix(a), _mix(b), _mix(c), _mix(c + step)


@lane_jit
def next_word(s0, s1, s2, s3):
    """One xoshiro256++ step: (word, new state)."""
    total = s0 + s3
    word = ((total << splat_bits(_B23)) | (total >> splat_bits(_B41))) + s0
    shifted = s1 << splat_bits(_B17)
    s2 = s2 ^ s0
    s3 = s3 ^ s1
    s1 = s1 ^ s2
    s0 = s0 ^ s3
    s2 = s2 ^ shifted
    s3 = (s3 << splat_bits(_B45)) | (s3 >> splat_bits(_B19))
    return word, s0, s1, s2, s3


@lane_jit
def one_to_two(word):
    """52 bits of the word as a double in [1, 2)."""
    return as_lanes((word >> splat_bits(_B12)) | splat_bits(_ONE))


@lane_jit
def normal_pair(first, second):
    """Box-Muller: two independent N(0, 1) from two words."""
    radius = square_root(splat(-2.0) * natural_log(splat(2.0) - one_to_two(first)))
    sine, cosine = sine_cosine_small((one_to_two(second) - splat(1.5)) * splat(1.5707963267948966))
    cosine = as_lanes(as_bits(cosine) ^ ((second << splat_bits(_B62)) & splat_bits(_SIGN)))
    swap = bits_set(second & splat_bits(_B1))
    return radius * select(swap, sine, cosine), radius * select(swap, cosine, sine)


@lane_jit
def fill_deviates(segments, stream, key, index, z):
    """Draw all columns of one stream for eight lanes into ``z`` (flat, column k at 8 k)."""
    s0, s1, s2, s3 = seed_states(key, index)
    for run in range(segments.shape[0]):
        if segments[run, 3] != stream:
            continue
        column, end, law = segments[run, 0], segments[run, 1], segments[run, 2]
        if law == 0:
            while column < end:
                first, s0, s1, s2, s3 = next_word(s0, s1, s2, s3)
                second, s0, s1, s2, s3 = next_word(s0, s1, s2, s3)
                a, b = normal_pair(first, second)
                store(z, 8 * column, a)
                if column + 1 < end:
                    store(z, 8 * column + 8, b)
                column += 2
        else:
            while column < end:
                word, s0, s1, s2, s3 = next_word(s0, s1, s2, s3)
                value = (one_to_two(word) - splat(1.5)) * splat(_WIDTHS[law - 1, 0])
                if _WIDTHS[law - 1, 1] > 0.0:
                    word, s0, s1, s2, s3 = next_word(s0, s1, s2, s3)
                    value = value + (one_to_two(word) - splat(1.5)) * splat(_WIDTHS[law - 1, 1])
                store(z, 8 * column, value)
                column += 1


@lane_entry
def draw_columns(segments, keys, units, trials, z, out):
    """Deviates of the given trials: ``out`` (d, n) with n a multiple of 8; ``z`` is scratch of 8 d."""
    for group in range(0, trials.size, 8):
        fill_deviates(segments, 0, keys[0], load(units, group), z)
        fill_deviates(segments, 1, keys[1], load(trials, group), z)
        for k in range(out.shape[0]):
            for lane in range(8):
                out[k, group + lane] = z[8 * k + lane]


_MANTISSA = np.uint64(0x000FFFFFFFFFFFFF)
_TWO52 = np.uint64(0x4330000000000000)  # pattern of 2^52: integers below 2^52 or-ed in become exact doubles
_EXPONENT_OFFSET = 2.0**52 + 1023.0
_ROUNDER = 1.5 * 2.0**52  # adding and subtracting rounds to the nearest integer
_LN2 = 0.6931471805599453
_PIO2_HIGH = 1.5707963267341256  # first 33 bits of pi/2: multiples up to 2^20 are exact
_PIO2_LOW = 6.077100506506192e-11


@lane_jit
def natural_log(x):
    """log of positive normal doubles; absolute error below 2e-15 on (0, 1]."""
    pattern = as_bits(x)
    exponent = as_lanes((pattern >> splat_bits(_B52)) | splat_bits(_TWO52)) - splat(_EXPONENT_OFFSET)
    mantissa = as_lanes((pattern & splat_bits(_MANTISSA)) | splat_bits(_ONE))
    large = mantissa > splat(1.4142135623730951)
    mantissa = select(large, mantissa * splat(0.5), mantissa)
    exponent = select(large, exponent + splat(1.0), exponent)
    # log m = 2 artanh s, s = (m - 1) / (m + 1), |s| < 0.1716
    s = (mantissa - splat(1.0)) / (mantissa + splat(1.0))
    z = s * s
    p = fma(z, splat(1.479819860511658591e-01), splat(1.531383769920937332e-01))
    p = fma(z, p, splat(1.818357216161805012e-01))
    p = fma(z, p, splat(2.222219843214978396e-01))
    p = fma(z, p, splat(2.857142874366239149e-01))
    p = fma(z, p, splat(3.999999999940941908e-01))
    p = fma(z, p, splat(6.666666666666735130e-01))
    return fma(exponent, splat(_LN2), fma(s * z, p, s + s))


@lane_jit
def sine_cosine_small(x):
    """(sin x, cos x) for |x| <= pi/4, to the last place."""
    z = x * x
    p = fma(z, splat(1.58969099521155010221e-10), splat(-2.50507602534068634195e-08))
    p = fma(z, p, splat(2.75573137070700676789e-06))
    p = fma(z, p, splat(-1.98412698298579493134e-04))
    p = fma(z, p, splat(8.33333333332248946124e-03))
    p = fma(z, p, splat(-1.66666666666666324348e-01))
    sine = fma(x * z, p, x)
    q = fma(z, splat(-1.13596475577881948265e-11), splat(2.08757232129817482790e-09))
    q = fma(z, q, splat(-2.75573143513906633035e-07))
    q = fma(z, q, splat(2.48015872894767294178e-05))
    q = fma(z, q, splat(-1.38888888888741095749e-03))
    q = fma(z, q, splat(4.16666666666666019037e-02))
    return sine, fma(z * z, q, fma(z, splat(-0.5), splat(1.0)))


@lane_jit
def sine_cosine(x):
    """(sin x, cos x) for |x| < 1e6 rad, absolute error below 2e-16 for the angles of a mount."""
    shifted = fma(x, splat(0.6366197723675814), splat(_ROUNDER))
    quarter = shifted - splat(_ROUNDER)
    sine, cosine = sine_cosine_small(fma(quarter, splat(-_PIO2_LOW), fma(quarter, splat(-_PIO2_HIGH), x)))
    turns = as_bits(shifted)  # its lowest bits count quarter turns
    half = (turns << splat_bits(_B62)) & splat_bits(_SIGN)
    quarter_bit = (turns << splat_bits(_B63)) & splat_bits(_SIGN)
    swapped = bits_set(quarter_bit)
    sine_out = select(swapped, cosine, sine)
    cosine_out = select(swapped, sine, cosine)
    # quadrants 2, 3: sine negative; quadrants 1, 2: cosine negative
    return as_lanes(as_bits(sine_out) ^ half), as_lanes(as_bits(cosine_out) ^ half ^ quarter_bit)


@lane_entry
def tabulate(x, out):
    """Apply the three functions to a padded array: rows of ``out`` are log, sin, cos.  For tests and tables."""
    for i in range(0, x.size, 8):
        value = load(x, i)
        store(out, i, natural_log(value))
        sine, cosine = sine_cosine(value)
        store(out, x.size + i, sine)
        store(out, 2 * x.size + i, cosine)
