"""Arithmetic with truncated Taylor series in time: results have exact derivatives.

A `Series` holds the coefficients f^(k)(t) / k! at many instants at once. Written once as a formula of the time's own
series, a motion has velocity, acceleration and angular velocity without finite differences and without formulas by
hand. Recurrences: Griewank & Walther, Evaluating Derivatives, 2nd ed., table 13.1 and 13.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Series:
    """c: [order + 1, n], coefficients at n instants. Operands are other series of that shape, or numbers."""

    __slots__ = ("c",)
    __array_ufunc__ = None  # operators with a NumPy number on the left call this class

    def __init__(self, c: NDArray[np.float64]):
        self.c = c

    @classmethod
    def variable(cls, t: ArrayLike, order: int) -> Series:
        """The series of t: derivative 1."""
        t = np.asarray(t, float)
        c = np.zeros((order + 1, len(t)))
        c[0] = t
        if order:
            c[1] = 1
        return cls(c)

    def derivative(self, k: int = 1) -> Series:
        """The k-th derivative, k orders shorter."""
        c = self.c
        for _ in range(k):
            c = c[1:] * np.arange(1, len(c))[:, None]
        return Series(c)

    def truncated(self, order: int) -> Series:
        return Series(self.c[: order + 1])

    def values(self, k: int = 0) -> NDArray[np.float64]:
        """[n]: the k-th derivative's values."""
        return self.c[k] * math.factorial(k)

    def _like(self, other) -> NDArray[np.float64]:
        if isinstance(other, Series):
            return other.c
        c = np.zeros_like(self.c)
        c[0] = other
        return c

    def __add__(self, other) -> Series:
        return Series(self.c + self._like(other))

    __radd__ = __add__

    def __neg__(self) -> Series:
        return Series(-self.c)

    def __sub__(self, other) -> Series:
        return Series(self.c - self._like(other))

    def __rsub__(self, other) -> Series:
        return Series(self._like(other) - self.c)

    def __mul__(self, other) -> Series:
        if not isinstance(other, Series):
            return Series(self.c * other)
        a, b = self.c, other.c
        c = np.empty_like(a)
        for k in range(len(a)):
            c[k] = (a[: k + 1] * b[k::-1]).sum(axis=0)
        return Series(c)

    __rmul__ = __mul__

    def __truediv__(self, other) -> Series:
        if not isinstance(other, Series):
            return Series(self.c / other)
        a, b = self.c, other.c
        c = np.empty_like(a)
        for k in range(len(a)):
            c[k] = (a[k] - (c[:k] * b[k:0:-1]).sum(axis=0)) / b[0]
        return Series(c)

    def __rtruediv__(self, other) -> Series:
        return Series(self._like(other)) / self

    def sqrt(self) -> Series:
        c = np.empty_like(self.c)
        c[0] = np.sqrt(self.c[0])
        for k in range(1, len(c)):
            c[k] = (self.c[k] - (c[1:k] * c[k - 1 : 0 : -1]).sum(axis=0)) / (2 * c[0])
        return Series(c)

    def exp(self) -> Series:
        c = np.empty_like(self.c)
        c[0] = np.exp(self.c[0])
        for k in range(1, len(c)):
            weights = np.arange(1, k + 1)[:, None] * self.c[1 : k + 1]
            c[k] = (weights * c[k - 1 :: -1][:k]).sum(axis=0) / k
        return Series(c)

    def sin_cos(self) -> tuple[Series, Series]:
        s, c = np.empty_like(self.c), np.empty_like(self.c)
        s[0], c[0] = np.sin(self.c[0]), np.cos(self.c[0])
        for k in range(1, len(s)):
            weights = np.arange(1, k + 1)[:, None] * self.c[1 : k + 1]
            s[k] = (weights * c[k - 1 :: -1][:k]).sum(axis=0) / k
            c[k] = -(weights * s[k - 1 :: -1][:k]).sum(axis=0) / k
        return Series(s), Series(c)


Vector = tuple[Series, Series, Series]


def polynomial(coefficients: NDArray[np.float64], x: Series) -> Series:
    """sum_k coefficients[k] x^k by Horner; coefficients: [degree + 1, n], lowest first, each instant its own."""
    total = x * 0 + coefficients[-1]
    for c in coefficients[-2::-1]:
        total = total * x + c
    return total


class Piecewise:
    """Polynomials between breaks, as scipy's PPoly has them: c [degree + 1, pieces], highest first."""

    def __init__(self, c: ArrayLike, breaks: ArrayLike):
        self.c, self.breaks = np.asarray(c, float), np.asarray(breaks, float)

    def derivative(self) -> Piecewise:
        powers = np.arange(len(self.c) - 1, 0, -1)
        return Piecewise(self.c[:-1] * powers[:, None], self.breaks)

    def __call__(self, x: Series) -> Series:
        piece = np.clip(np.searchsorted(self.breaks, x.c[0], side="right") - 1, 0, self.c.shape[1] - 1)
        return polynomial(self.c[::-1, piece], x - self.breaks[piece])


def spline(t: ArrayLike, values: ArrayLike, degree: int, knot_s: float | None = None) -> list[Piecewise]:
    """Splines of `degree` (odd), degree - 1 times continuously differentiable, one per column of values [n, m], through
    all of them; with knot_s, those with knots that far apart that come nearest (least squares).

    Interpolating ones are natural: derivatives (degree + 1)/2 … degree - 1 vanish at the ends. Of all functions through
    the points, that has the least integral of the squared derivative (degree + 1)/2: degree 7 is the minimum snap
    (Mellinger & Kumar 2011) of a flight cut out of a longer one.
    """
    from scipy.interpolate import make_interp_spline, make_lsq_spline

    t, values = np.asarray(t, float), np.asarray(values, float)
    if knot_s is not None and (inner := round((t[-1] - t[0]) / knot_s)) * 2 < len(t) - degree:
        knots = np.linspace(t[0], t[-1], max(inner, 1) + 1)
        fitted = make_lsq_spline(t, values, np.r_[[t[0]] * degree, knots, [t[-1]] * degree], degree)
    elif len(t) >= (degree + 1) // 2:
        ends = [(k, np.zeros(values.shape[1])) for k in range((degree + 1) // 2, degree)]
        fitted = make_interp_spline(t, values, degree, bc_type=(ends, ends))
    else:  # a polynomial through so few points has no such derivatives
        fitted = make_interp_spline(t, values, len(t) - 1)
    breaks = np.unique(fitted.t[(fitted.t >= t[0]) & (fitted.t <= t[-1])])
    powers = range(fitted.k, -1, -1)
    c = np.array([fitted(breaks[:-1], nu=k) / math.factorial(k) for k in powers])  # of the piece that begins there
    return [Piecewise(c[:, :, column], breaks) for column in range(values.shape[1])]


def dot(a: Sequence[Series], b: Sequence) -> Series:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence, b: Sequence) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def unit(a: Sequence[Series]) -> Vector:
    length = dot(a, a).sqrt()
    return a[0] / length, a[1] / length, a[2] / length


def values(vector: Sequence[Series], k: int = 0) -> NDArray[np.float64]:
    """[n, 3]: the k-th derivatives of a vector."""
    return np.stack([component.values(k) for component in vector], axis=-1)


# A rotation is its three columns: the images of the x, y and z axes.
Rotation = tuple[Vector, Vector, Vector]


def turned(rotation: Rotation, local: Rotation) -> Rotation:
    """rotation @ local."""
    x, y, z = rotation
    columns = [tuple(x[i] * c[0] + y[i] * c[1] + z[i] * c[2] for i in range(3)) for c in local]
    return columns[0], columns[1], columns[2]


def matrices(rotation: Rotation, k: int = 0) -> NDArray[np.float64]:
    """[n, 3, 3]: the k-th derivatives of a rotation matrix."""
    return np.stack([values(column, k) for column in rotation], axis=-1)


def small_turn(pitch: Series, yaw: Series, roll: Series) -> Rotation:
    """Rz(roll) @ Ry(yaw) @ Rx(pitch) about a camera's axes (x right, y down, z ahead): positive pitch looks up, yaw
    right."""
    (sp, cp), (sy, cy), (sr, cr) = pitch.sin_cos(), yaw.sin_cos(), roll.sin_cos()
    return (
        (cr * cy, sr * cy, -sy),
        (cr * sy * sp - sr * cp, sr * sy * sp + cr * cp, cy * sp),
        (cr * sy * cp + sr * sp, sr * sy * cp - cr * sp, cy * cp),
    )
