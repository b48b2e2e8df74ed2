"""Ports: a disturbance of a model at each place, with the slope that the place says."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.model.port import check_ports, ports_of, with_ports


def model() -> cs.Model:
    return cs.define_model(
        "tank",
        states=("h",),
        inputs=("u",),
        parameters={"a": 0.3, "k": 2.0},
        outputs=("level",),
        dynamics=lambda s: {"h": s.k * s.u - s.a * s.h**2},
        output=lambda s: {"level": s.h + 0.1 * s.u},
    )


def test_a_port_at_every_place_that_is_not_exact() -> None:
    assert [p.station for p in ports_of(model())] == ["f_h", "d_u", "reading_level"]
    assert [p.station for p in ports_of(model(), exact=("h", "level"))] == ["d_u"]


def test_slopes_of_the_ports_are_those_of_the_places() -> None:
    """At an input that of the input, at an equation and a reading one."""
    base = model()
    wide = with_ports(base, ports_of(base))
    slopes = ca.Function("s", [wide.x, wide.u, wide.p, wide.w], [ca.jacobian(ca.vertcat(wide.f, wide.h), wide.w)])
    found = slopes(1.5, 0.7, [0.3, 2.0], np.zeros(3)).full()
    assert found == pytest.approx(np.array([[1.0, 2.0, 0.0], [0.0, 0.1, 1.0]]))


def test_a_port_at_which_a_model_has_a_disturbance_keeps_it() -> None:
    """As the model of an aircraft has at its surfaces."""
    wide = with_ports(model(), ports_of(model(), exact=("h",)))
    assert with_ports(wide, ports_of(model())).disturbances == ("d_u", "reading_level", "f_h")


def test_a_port_that_is_not_there_and_one_that_stands_twice() -> None:
    with pytest.raises(cs.InputError, match="did you mean 'level'"):
        check_ports(model(), [cs.ModelPort(kind="output", name="levl")])
    with pytest.raises(cs.InputError, match="stands twice"):
        check_ports(model(), [cs.ModelPort(kind="input", name="u")] * 2)
    with pytest.raises(cs.InputError, match="positive"):
        cs.ModelPort(kind="input", name="u", matters=0.0)
