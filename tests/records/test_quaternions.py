"""Quaternion columns. Truth: attitude and rates of a motion whose angles are given, by the kinematic equations of
3-2-1 Euler angles (Stevens and Lewis, 1.4-4), and the quaternion by products of half turns about z, y, x."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import casid as cs

N = 400
T = 0.02 * np.arange(N)


def motion(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, 3) angles, (N, 3) rates and (N, 4) quaternions w x y z from body to earth axes."""
    rng = np.random.default_rng(seed)
    size, phase, at = rng.uniform(0.2, 0.6, 3), rng.uniform(0.0, 6.0, 3), rng.uniform(0.5, 1.5, 3)
    angles = size * np.sin(at * T[:, None] + phase) + np.array([0.0, 0.1, rng.uniform(-3.0, 3.0)])
    dphi, dtheta, dpsi = (size * at * np.cos(at * T[:, None] + phase)).T
    phi, theta, _ = angles.T
    p = dphi - np.sin(theta) * dpsi
    q = np.cos(phi) * dtheta + np.sin(phi) * np.cos(theta) * dpsi
    r = -np.sin(phi) * dtheta + np.cos(phi) * np.cos(theta) * dpsi
    turn = Rotation.from_euler("ZYX", angles[:, ::-1]).as_quat(scalar_first=True)
    return angles, np.stack([p, q, r], axis=1), turn


def record(path: Path, names: list[str], columns: np.ndarray, rates: np.ndarray | None, **options: str) -> cs.Record:
    table = [T, *columns.T, *(() if rates is None else rates.T), 0.01 * np.sin(T)]
    head = ["t", *names, *(() if rates is None else "pqr"), "delta_e"]
    np.savetxt(path / "m.csv", np.stack(table, axis=1), delimiter=",", header=",".join(head), comments="", fmt="%.12g")
    return cs.read_record(path / "m.csv", options or None)


def same(found: cs.Record, angles: np.ndarray) -> None:
    np.testing.assert_allclose(found.matrix(["phi", "theta"]), angles[:, :2], atol=1e-6)
    off = found["psi"] - angles[:, 2]
    np.testing.assert_allclose(off, 2.0 * np.pi * np.round(off[0] / (2.0 * np.pi)), atol=1e-6)


NAMES = [["q0", "q1", "q2", "q3"], ["q[0]", "q[1]", "q[2]", "q[3]"], ["quat_1", "quat_2", "quat_3", "quat_4"]]


@given(
    seed=st.integers(0, 999),
    names=st.sampled_from(NAMES),
    last=st.booleans(),
    turned=st.booleans(),
    signs=st.booleans(),
)
@settings(max_examples=40, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
def test_the_rates_tell_order_and_direction(
    seed: int, names: list[str], last: bool, turned: bool, signs: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Of all four ways; q and -q are one attitude, and a log may go from one to the other."""
    angles, rates, turn = motion(seed)
    turn = turn * ([1.0, -1.0, -1.0, -1.0] if turned else 1.0)
    turn = np.where(signs & (np.arange(N) > N // 2), -1.0, 1.0)[:, None] * turn
    turn = turn[:, [1, 2, 3, 0]] if last else turn
    found = record(tmp_path_factory.mktemp("q"), names, turn, rates)
    same(found, angles)
    assert "quaternion" in found.contents.read["phi"]


@pytest.mark.parametrize("with_rates", [True, False])
@pytest.mark.parametrize(
    "names",
    [
        ["qw", "qx", "qy", "qz"],
        ["orientation." + c for c in "wxyz"],
        ["att_q_" + c for c in "WXYZ"],
        [f"q_RS_{c}" for c in "wxyz"],
    ],
)
def test_letters_state_the_order(tmp_path: Path, names: list[str], with_rates: bool) -> None:
    angles, rates, turn = motion(1)
    shuffled = [2, 0, 3, 1]
    same(record(tmp_path, [names[i] for i in shuffled], turn[:, shuffled], rates if with_rates else None), angles)


def test_without_rates_an_order_is_not_guessed_and_a_map_states_it(tmp_path: Path) -> None:
    angles, _, turn = motion(2)
    found = record(tmp_path, NAMES[0], turn, None)
    assert "phi" not in found and any("--map q_w=COLUMN" in note for note in found.notes)
    same(record(tmp_path, NAMES[0], turn, None, q_w="q0", q_x="q1", q_y="q2", q_z="q3"), angles)


def test_what_is_no_unit_quaternion_or_does_not_turn_so_is_left_as_it_is(tmp_path: Path) -> None:
    angles, rates, turn = motion(3)
    assert "phi" not in record(tmp_path, NAMES[0], 2.0 * turn, rates)
    other = record(tmp_path, NAMES[0], turn, motion(4)[1])
    assert "phi" not in other and any("in no order" in note for note in other.notes)
    assert all(name in other for name, _ in product(NAMES[0], [0]))
