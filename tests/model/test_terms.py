"""Monomials: the truth is the algebra written out by hand."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casid.errors import InputError
from casid.model.terms import COEFFICIENTS, VARIABLES, Term, derivative_name, derivative_term, parse_term

POWERS = st.dictionaries(st.sampled_from(VARIABLES), st.integers(1, 9), max_size=4)
TERMS = POWERS.map(lambda powers: Term(factors=tuple((v, powers[v]) for v in VARIABLES if v in powers)))


@given(TERMS)
def test_name_is_read_back(term):
    assert parse_term(term.name) == term


@given(st.sampled_from(COEFFICIENTS), TERMS)
def test_parameter_name_is_read_back(coefficient, term):
    assert derivative_term(derivative_name(coefficient, term)) == (coefficient, term)


@given(st.text("alphbetq_dr0^*123456789 ()+.[],|", max_size=12))
def test_any_text_is_a_term_or_an_input_error(text):
    try:
        term = parse_term(text)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert parse_term(term.name) == term


@pytest.mark.parametrize(
    ("text", "name", "degree", "unit"),
    [
        ("alpha", "alpha", 1, "1/rad"),
        ("alpha * alpha", "alpha^2", 2, "1/rad2"),
        ("delta_e*alpha", "alpha*delta_e", 2, "1/rad2"),
        ("beta^2*alpha*beta", "alpha*beta^3", 4, "1/rad4"),
        ("mach", "mach", 1, "1"),
        ("V*alpha", "alpha*V", 2, "1/rad"),
        ("0", "0", 0, "1"),
        ("|beta|", "|beta|", 1, "1/rad"),
        ("| beta | * beta", "beta*|beta|", 2, "1/rad2"),
        ("|alpha|*|alpha|*|alpha|", "alpha^2*|alpha|", 3, "1/rad3"),
    ],
)
def test_canonical_form(text, name, degree, unit):
    term = parse_term(text)
    assert (term.name, term.degree, term.unit) == (name, degree, unit)


def test_evaluates_alike_for_numbers_arrays_and_casadi():
    term = parse_term("alpha^3*beta*|beta|*delta_e^2")
    rng = np.random.default_rng(1)
    values = {v: rng.normal(size=7) for v in VARIABLES}
    truth = values["alpha"] ** 3 * values["beta"] * np.abs(values["beta"]) * values["delta_e"] ** 2
    np.testing.assert_allclose(term.evaluate(values), truth, rtol=1e-14)
    symbols = {v: ca.SX.sym(v) for v in VARIABLES}
    function = ca.Function("f", list(symbols.values()), [term.evaluate(symbols)])
    for k in range(7):
        numbers = {v: float(values[v][k]) for v in VARIABLES}
        assert term.evaluate(numbers) == pytest.approx(truth[k], rel=1e-14)
        assert float(function(*numbers.values())) == pytest.approx(truth[k], rel=1e-14)


def test_constant_is_one():
    assert parse_term("0").evaluate({}) == 1.0


def test_missing_value_is_named():
    with pytest.raises(InputError, match="no value for 'beta'"):
        parse_term("alpha*beta").evaluate({"alpha": 1.0})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("aplha^2", "did you mean 'alpha'"),
        ("qbar", "unknown variable 'qbar'"),
        ("alpha**2", "not a monomial"),
        ("alpha^0", "powers 1 to 9"),
        ("alpha^2.5", "not a monomial"),
        ("alpha+beta", "not a monomial"),
        ("__import__('os')", "not a monomial"),
        ("", "not a monomial"),
        ("alpha^9*alpha", "power above 9"),
        ("|alpha|^2", "not a monomial"),
        ("|alpha", "not a monomial"),
    ],
)
def test_what_is_no_term_is_an_error(text, message):
    with pytest.raises(InputError, match=message.replace("^", r"\^")):
        parse_term(text)


@pytest.mark.parametrize(
    ("name", "suggestion"),
    [("Cm_aplha", "Cm_alpha"), ("Clp", "Cl_p"), ("CM_alpha", "Cm_alpha"), ("Cl_deltar", "Cl_delta_r")],
)
def test_a_wrong_derivative_gets_the_nearest_name(name, suggestion):
    with pytest.raises(InputError, match=f"did you mean '{suggestion}'"):
        derivative_term(name)


@pytest.mark.parametrize("term", ["alpha", "alpha^2", "alpha*beta^2", "q*delta_e", "alpha*|beta|", "beta*|beta|"])
def test_the_slope_of_a_term_is_its_derivative(term: str) -> None:
    """Central differences, which are exact to rounding for these powers."""
    at = {"alpha": 0.1, "beta": -0.05, "q": 0.02, "delta_e": 0.2}
    for name in at:
        above, below = (parse_term(term).evaluate({**at, name: at[name] + h}) for h in (1e-4, -1e-4))
        assert parse_term(term).slope(name, at) == pytest.approx((above - below) / 2e-4, abs=1e-10)
