"""The default smoother: a bank of Kalman filters steered by the cloud of innovations."""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]
_I3 = np.arange(3)


@tuned_options('cloud-kalman')
class CloudKalmanOptions(Options):
    """Options of the default smoother."""

    window: float = option(40.0, 'innovations that make up the cloud', '', (2.0, 1e4))
    still_density: float = option(1e-8, 'random walk still', 'm^2/s', (0.0, 1e6))
    slow_density: float = option(1e-5, 'slow', 'm^2/s^3', (0.0, 1e6))
    turn_acceleration: float = option(0.3, 'fast', 'm/s^2', (0.0, 1e6))
    turn_time: float = option(1.0, 'fast', 's', (1e-3, 1e6))
    fast_density: float = option(1e-5, 'slow', 'm^2/s^3', (0.0, 1e6))
    start_speed: float = option(0.05, 'speed when still target goes', 'm/s', (1e-6, 100.0))
    still_dwell: float = option(2.0, 'dwell', 's', (1e-3, 1e4))
    slow_dwell: float = option(2.0, 'dwell', 's', (1e-3, 1e4))
    fast_dwell: float = option(1.0, 'dwell', 's', (1e-3, 1e4))
    wave_std: float = option(0.004, 'start', 'm', (0.0, 10.0))
    wave_frequency: float = option(2.8, 'start', 'Hz', (0.1, 100.0))
    wave_damping: float = option(0.25, 'damping', '', (0.01, 0.99))
    measurement_scale: float = option(1.5, 'factor', '', (1e-3, 1e6))
    certainty_width: float = option(3.0, 'welsch', '', (0.5, 100.0))
    covariance_scale: float = option(1.0, 'factor', '', (1e-3, 1e6))


class _Memory(NamedTuple):
    states: Array  # (M,3,5): p v a s u along each of the axes
    covariances: Array  # (M,3,5,5)
    weights: Array
    power: Array  # wave variance per axis (3,), m^2
    omega: Array
    moments: Array  # (2,3)
    axes: Array  # (3,3) rows
    total: int
    certainty: float


class CloudKalmanFilter(Filter[_Memory]):
    """Kalman filter whose noises follow the cloud of its innovations."""

    name: ClassVar[str] = 'cloud-kalman'
    options_class: ClassVar[type[Options]] = CloudKalmanOptions
    options: CloudKalmanOptions

    def __init__(self, **options):
        super().__init__(**options)
        o = self.options
        self._entry = np.zeros((3, 3, 5))  # i->j, diag var of new components
        self._entry[0, 1:, 1] = o.start_speed**2
        self._entry[:2, 2, 2] = o.turn_acceleration**2
        self._dwell = np.array([o.still_dwell, o.slow_dwell, o.fast_dwell])

    def _start(self, position: Array, covariance: Array) -> _Memory:
        o = self.options
        axes = _line_of_sight_axes(covariance, np.eye(3))
        r = np.diagonal(axes @ covariance @ axes.T)
        power = o.wave_std**2 * r / (0.5 * (r[0] + r[1]))
        P = np.zeros((3, 3, 5, 5))
        P[:, :, 0, 0] = o.measurement_scale * r + power
        P[1:, :, 1, 1] = o.start_speed**2
        P[2, :, 2, 2] = o.turn_acceleration**2
        P[:, :, 3, 3] = P[:, :, 4, 4] = power
        P[:, :, 0, 4] = P[:, :, 4, 0] = -power
        x = np.zeros((3, 3, 5))
        x[:, :, 0] = axes @ position
        omega = np.full(3, 2 * math.pi * o.wave_frequency)
        return _Memory(
            x, P, np.full(3, 1 / 3), power, omega, np.array([power, power]), axes, 1, 1.0
        )

    def _advance(self, m: _Memory, dt: float) -> _Memory:
        o = self.options
        stay = np.exp(-dt / self._dwell)
        T = np.tile(0.5 * (1.0 - stay)[:, None], (1, 3))
        T[_I3, _I3] = stay
        c = m.weights @ T
        mix = T * m.weights[:, None] / c
        ref = m.states[0]
        Y = m.states - ref
        y0 = (mix.T @ Y.reshape(3, 15)).reshape(3, 3, 5)
        G = m.covariances + Y[..., :, None] * Y[..., None, :]
        P0 = (mix.T @ G.reshape(3, 75)).reshape(3, 3, 5, 5) - y0[..., :, None] * y0[..., None, :]
        E = np.einsum('ij,ijk->jk', mix, self._entry)
        k = np.arange(5)
        P0[:, :, k, k] += E[:, None, :]
        x0 = y0 + ref
        F = np.zeros((3, 3, 5, 5))
        F[:, :, 0, 0] = 1.0
        F[1:, :, 0, 1] = dt
        F[1:, :, 1, 1] = 1.0
        tau = o.turn_time
        e = math.exp(-dt / tau)
        F[2, :, 0, 2] = tau * tau * (e - 1 + dt / tau)
        F[2, :, 1, 2] = tau * (1 - e)
        F[2, :, 2, 2] = e
        damping = o.wave_damping
        damped = math.sqrt(1 - damping**2)
        angle = damped * dt * m.omega
        decay = np.exp(-damping * dt * m.omega)
        cs = decay * np.cos(angle)
        sn = decay * np.sin(angle) / damped
        aa, uu = cs + damping * sn, cs - damping * sn
        F[:, :, 3, 3] = aa
        F[:, :, 3, 4] = sn
        F[:, :, 4, 3] = -sn
        F[:, :, 4, 4] = uu
        Q = np.zeros((3, 3, 5, 5))
        Q[0, :, 0, 0] = o.still_density * dt
        for j, q in ((1, o.slow_density), (2, o.fast_density)):
            Q[j, :, 0, 0] = q * dt**3 / 3
            Q[j, :, 0, 1] = Q[j, :, 1, 0] = q * dt**2 / 2
            Q[j, :, 1, 1] = q * dt
        q = 2 * o.turn_acceleration**2 / tau
        Q[2, :, :3, :3] += q * np.array(
            [
                [dt**5 / 20, dt**4 / 8, dt**3 / 6],
                [dt**4 / 8, dt**3 / 3, dt**2 / 2],
                [dt**3 / 6, dt**2 / 2, dt],
            ]
        )
        Q[:, :, 3, 3] = m.power * (1 - aa * aa - sn * sn)
        Q[:, :, 4, 4] = m.power * (1 - sn * sn - uu * uu)
        Q[:, :, 3, 4] = Q[:, :, 4, 3] = -m.power * (sn * uu - aa * sn)
        x = (F @ x0[..., None])[..., 0]
        P = F @ P0 @ F.transpose(0, 1, 3, 2) + Q
        return m._replace(states=x, covariances=P, weights=c)

    def _correct(self, m: _Memory, position: Array, covariance: Array) -> tuple[_Memory, str]:
        o = self.options
        axes = _line_of_sight_axes(covariance, m.axes)
        states = m.states
        turn = axes @ m.axes.T
        states = np.concatenate([turn @ states[..., :3], states[..., 3:]], axis=-1)
        r = o.measurement_scale * np.diagonal(axes @ covariance @ axes.T)
        nu = axes @ position - states[..., 0] - states[..., 4]
        P = m.covariances
        PH = P[..., 0] + P[..., 4]
        S = PH[..., 0] + PH[..., 4] + r
        d2 = np.sum(nu * nu / S, axis=1)
        best = d2.min()
        lam = math.exp(-0.5 * best / o.certainty_width**2)
        if lam < 1e-8:
            return m._replace(certainty=0.0), f'uncertain {best}'
        K = PH * (lam / S)[..., None]
        x = states + K * nu[..., None]
        P = P - K[..., :, None] * PH[..., None, :]
        logL = -0.5 * lam * d2 - 0.5 * np.log(S).sum(axis=1)
        logL -= logL.max()
        w = m.weights * np.exp(logL) + 1e-12
        w /= w.sum()
        a = lam / min(m.total + 1, o.window)
        mean = np.tensordot(w, x[:, :, 3:], 1)
        k = np.arange(3, 5)
        var = np.tensordot(w, P[:, :, k, k] + (x[:, :, 3:] - mean) ** 2, 1)
        m2 = (mean**2 + var).T
        mom = (1 - a) * m.moments + a * m2
        omega = m.omega * (1 + a * 0.5 * (mom[1] / mom[0] - 1.0))
        omega = np.clip(omega, 2 * math.pi * 1.2, 2 * math.pi * 7)
        return _Memory(x, P, w, mom[1], omega, mom, axes, m.total + 1, lam), ''

    def _estimate(self, m: _Memory) -> Estimate:
        w = m.weights
        x = m.states[..., :2]
        mean = np.tensordot(w, x, 1)
        D = x - mean
        V = np.tensordot(w, m.covariances[..., :2, :2] + D[..., :, None] * D[..., None, :], 1)
        C = np.einsum('kab,ki,kj->aibj', V, m.axes, m.axes).reshape(6, 6)
        pv = m.axes.T @ mean
        return Estimate(pv[:, 0], pv[:, 1], self.options.covariance_scale * C, m.certainty)


def _line_of_sight_axes(covariance: Array, axes: Array) -> Array:
    e3 = covariance @ axes[2]
    if not np.any(e3):
        return axes
    e3 = e3 / np.linalg.norm(e3)
    e1 = axes[0] - (axes[0] @ e3) * e3
    e1 = e1 / np.linalg.norm(e1)
    return np.array([e1, np.cross(e3, e1), e3])
