"""Published problems: their domain and costs, written out independently, and their sections."""

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.optimize import minimize

import mppi_belief as mb
from cli_helpers import CONF, collect
from helpers import quick_jit
from mppi_belief.belief.gaussian import RootBelief
from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.sections import study_sections
from mppi_belief.report.sections.published_problems import kept_beliefs, problem_frame
from mppi_belief.trial import CellParts, build
from report_helpers import SCENE, cell_of, results_of, trial_rows

LIGHT = 5.0
# Q, R, L of J = sum (m' Q m + u' R u) + m_T' L m_T + tr(L Sigma_T), prior variance, `const`, T
PUBLISHED = {
    "platt_2010": (0.5, 0.5, 200.0, 5.0, 1.0, 30),
    "van_den_berg_2012": (0.0, 1.0, 10.0 * 25, 1.0, 1e-4, 25),
}


def published(
    study: str, controls: jax.Array, on_state: float = 0.0
) -> tuple[jax.Array, jax.Array]:
    """Returns J () of controls (T, 2) from (2, 2), and the means (T, 2) on the way.

    Every measurement is the most likely one. The variance s is that of both coordinates; `on_state`
    of it is charged on the way as well.
    """
    Q, R, last, prior, const, _ = PUBLISHED[study]

    def step(
        carry: tuple[jax.Array, jax.Array], u: jax.Array
    ) -> tuple[tuple[jax.Array, jax.Array], tuple]:
        m = carry[0] + u
        s = carry[1]
        s = 1 / (1 / s + 1 / (0.5 * (LIGHT - m[0]) ** 2 + const))
        return (m, s), (Q * (m @ m + 2 * on_state * s) + R * u @ u, m)

    (m, s), (charged, means) = jax.lax.scan(
        step, (jnp.array([2.0, 2.0]), jnp.array(prior)), controls
    )
    return jnp.sum(charged) + last * (m @ m + 2 * s), means


def planner(study: str) -> CellParts:
    (config,) = collect(f"experiment={study}", "controller=belief_joint", "precision=float64")
    return build(config)


def planned(parts: CellParts, controls: np.ndarray) -> tuple[jax.Array, jax.Array]:
    """Returns state costs (N,) and means (T, 2, N) of controls (T, 2, N) from the prior."""
    problem = parts.problem
    start = RootBelief(jnp.asarray(problem.prior_mean), jnp.diag(jnp.asarray(problem.prior_std)))
    planner = parts.controller
    paths = jnp.asarray(controls)
    plan = planner.schedule.plan(problem, planner.path_cost, start, paths[:, :, 0])
    return plan.costs(paths, None)


@pytest.mark.parametrize("study", PUBLISHED)
def test_the_domain_is_the_published_one(study, x64, rng):
    problem = planner(study).problem
    system = problem.system
    const = PUBLISHED[study][4]
    steps = PUBLISHED[study][5]
    for x, u in rng.normal(0, 3, size=(5, 2, 2)):
        np.testing.assert_allclose(
            mb.discretise.euler_step(system, jnp.asarray(x), jnp.asarray(u), problem.dt), x + u
        )
        noise = mb.discretise.measurement_cov(problem, jnp.asarray(x))
        np.testing.assert_allclose(noise, ((5 - x[0]) ** 2 / 2 + const) * np.eye(2))
        np.testing.assert_array_equal(system.c(jnp.asarray(x)), x)
    np.testing.assert_allclose(np.square(problem.prior_std), PUBLISHED[study][3])
    assert (problem.prior_mean == np.array([2.0, 2.0])).all()
    assert problem.steps == steps


@pytest.mark.parametrize("study", PUBLISHED)
def test_a_planned_path_costs_what_was_published(study, x64, rng):
    """Platt et al. do not charge the covariance on the way; an expected cost of the state does."""
    parts = planner(study)
    controls = rng.normal(0, 0.5, size=(6, 2))
    cell_that_reaches, means = planned(parts, controls[:, :, None])
    J, expected = published(study, jnp.asarray(controls), on_state=1.0)
    effort = PUBLISHED[study][1] * np.sum(controls**2)
    np.testing.assert_allclose(means[:, :, 0], expected, atol=1e-12)
    np.testing.assert_allclose(
        cell_that_reaches[0], J - effort, rtol=1e-6
    )  # their process noise of 1e-8 is not in J
    R = np.asarray(parts.problem.cost.R)
    np.testing.assert_allclose(np.einsum("ti,ij,tj->", controls, R, controls) / 2, effort)


@pytest.mark.long
@pytest.mark.parametrize(
    ("study", "furthest", "J"), [("platt_2010", 4.49, 117.2), ("van_den_berg_2012", 4.99, 2.85)]
)
def test_the_plan_of_least_published_cost_goes_to_the_light(study, furthest, J, x64):
    """The numbers that docs/beyond/published_problems.md gives beside ours."""
    steps = PUBLISHED[study][5]
    there = steps // 2
    back = steps - steps // 2
    first = np.vstack(
        [np.tile([3 / there, -2 / steps], (there, 1)), np.tile([-5 / back, -2 / steps], (back, 1))]
    )
    slope = quick_jit(jax.value_and_grad(lambda z: published(study, z.reshape(-1, 2))[0]))
    firsts = (np.zeros_like(first), first)
    plans = [
        minimize(slope, z.ravel(), jac=True, method="L-BFGS-B", options={"maxiter": 3000})
        for z in firsts
    ]
    best = min(plans, key=lambda plan: plan.fun)
    _, means = published(study, best.x.reshape(-1, 2))
    assert best.fun == pytest.approx(J, rel=0.01)
    assert float(means[:, 0].max()) == pytest.approx(furthest, abs=0.01)
    np.testing.assert_allclose(means[-1], 0, atol=0.01)
    text = (CONF.parent / "docs" / "beyond" / "published_problems.md").read_text()
    assert f"best plan | {furthest} m |" in text
    straight = np.full((steps, 2), -2 / steps)
    by_the_light, at_once = planned(
        planner(study), np.stack([best.x.reshape(-1, 2), straight], axis=-1)
    )[0]
    R = PUBLISHED[study][1]
    assert by_the_light + R * np.sum(best.x**2) < at_once + R * np.sum(straight**2)


def cell_that_reaches(method: str, reaches: list[float], **changed) -> CellResults:
    """Returns a cell whose kept trials go to these x and back, 0.3 m uncertain; trial 9 failed."""
    cell = cell_of(method)
    cell = cell._replace(config=cell.config | {"system": {"light": LIGHT}})
    rows = [trial | {"final_distance": 0.1 * trial["trial"]} for trial in trial_rows(5)]
    covariances = ([4.0, 0.0, 0.0, 4.0], [1.0, 0.0, 0.0, 1.0], [0.08, 0.0, 0.0, 0.1])
    steps = []
    for trial, reach in [*enumerate(reaches), (9, 5.0)]:
        for k, (x, cov) in enumerate(zip((2.0, reach, 0.0), covariances, strict=True)):
            belief = {"mean": np.array([x, 9.0]), "cov": np.array(cov)}
            steps.append({"trial": trial, "step": k, "state": np.zeros(2), **belief})
    return results_of(cell, rows)._replace(
        paths=pd.DataFrame(steps), scene=SCENE | {"obstacles": []}, **changed
    )


def test_what_a_belief_did_is_read_from_the_kept_trials():
    beliefs = kept_beliefs(cell_that_reaches("ce", [3.9, 4.0, 6.1, 5.5]))
    np.testing.assert_allclose(beliefs.furthest, [3.9, 4.0, 6.1, 5.5])
    np.testing.assert_array_equal(beliefs.in_light, [False, True, False, True])
    np.testing.assert_allclose(beliefs.final_sd, 0.3)


@pytest.mark.long
def test_a_report_tells_both_problems(tmp_path):
    studies = {
        name: [cell_that_reaches("belief_joint", [5.0, 4.5]), cell_that_reaches("ce", [2.0, 2.5])]
        for name in PUBLISHED
    }
    sections = study_sections(studies, tmp_path)
    assert [section.title.rpartition(" of ")[2] for section in sections] == [
        "Platt et al. 2010",
        "van den Berg et al. 2012",
    ]
    for name, section in zip(PUBLISHED, sections, strict=True):
        frame = section.tables[0].frame
        assert [text.split()[0] for text in frame["in the light % [95 %]"]] == ["100", "0"]
        assert list(frame["furthest x m"]) == ["4.75", "2.25"]
        assert list(frame["median distance m"]) == ["0.20", "0.20"]
        assert "CE-MPPI costs 50.0" in section.text[1]
        assert section.tables[1].frame["Pairs"].item() == "5"
        assert (tmp_path / f"{name}.png").exists()


def test_a_cell_without_kept_trials_has_a_line():
    bare = cell_that_reaches("ce", [])._replace(
        paths=pd.DataFrame(columns=["trial", "step", "state", "mean", "cov"])
    )
    assert problem_frame([bare])["furthest x m"].item() == "-"
