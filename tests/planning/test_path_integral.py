"""The parts of the sampler: against plain loops, and the desirability against an exact Gaussian
integral.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
import reference
from helpers import SIGMAS, Scalar, assert_covariance, light_dark_problem, quick_jit, random_spd
from mppi_belief.planning import path_integral as pi
from mppi_belief.planning import path_weights as pw

DT = 0.1
rollouts = quick_jit(pi.rollouts)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (4, 2), (3, 3), (5, 1)])
def test_control_map_undoes_g_of_full_column_rank(n, m, x64, rng):
    G = rng.normal(size=(n, m))
    R = random_spd(rng, m, 0.1, 10.0)
    computed = pi.control_map(jnp.asarray(G), jnp.asarray(R))
    np.testing.assert_allclose(computed @ G, np.eye(m), atol=1e-10)
    np.testing.assert_allclose(computed, reference.control_map(G, R), atol=1e-10)


@pytest.mark.parametrize(("n", "m", "rank"), [(4, 3, 1), (4, 3, 2), (2, 4, 2), (3, 2, 0)])
def test_control_map_of_rank_deficient_g_is_the_pseudoinverse(n, m, rank, x64, rng):
    G = rng.normal(size=(n, rank)) @ rng.normal(size=(rank, m))
    R = random_spd(rng, m, 0.1, 10.0)
    computed = pi.control_map(jnp.asarray(G), jnp.asarray(R))
    np.testing.assert_allclose(computed, reference.control_map(G, R), atol=1e-9)
    np.testing.assert_allclose(G @ computed @ G, G, atol=1e-10)
    # among the controls with the same effect the one of least u' R u: (R u)' v = 0 wherever G v = 0
    kernel = np.eye(m) - np.linalg.pinv(G, rcond=1e-10) @ G
    np.testing.assert_allclose(kernel @ R @ computed, 0, atol=1e-9)


@pytest.mark.parametrize("disturbed", [True, False])
@pytest.mark.parametrize("together", [True, False])
def test_rollouts_equal_a_loop(disturbed, together, x64, rng):
    """From one mean, or from a mean for each sample."""
    problem = light_dark_problem()
    H = 6
    N = 5
    model = reference.light_dark(sampled=True, dt=DT)
    starts = rng.normal(size=(4, 1 if together else N))
    controls = rng.normal(size=(H, 2, N))
    pushes = rng.normal(size=(H, 4, N))
    computed = pi.rollouts(
        problem,
        jnp.asarray(starts[:, 0] if together else starts),
        controls,
        pushes if disturbed else None,
    )
    assert computed.shape == (H, 4, N)
    for i in range(N):
        mu = starts[:, 0 if together else i]
        for k in range(H):
            mu = (
                mu + (model.A @ mu + model.B @ controls[k, :, i]) * DT + disturbed * pushes[k, :, i]
            )
            np.testing.assert_allclose(computed[k, :, i], mu, atol=1e-12)


@pytest.mark.parametrize("charged", [(0.0,), (1.0,), (0.25, 0.5, 0.75, 1.0), (0.0, 0.5)])
def test_accumulated_costs_equal_a_loop(charged, x64, rng):
    problem = light_dark_problem()
    H = 4
    N = 3
    start = rng.normal(size=4)
    means = rng.normal(size=(H, 4, N))
    covs = rng.normal(size=(H + 1, 4, 4))

    def running(mu: Array, cov: Array) -> Array:
        return mu[0] ** 2 + mu[2] * cov[0, 1]

    def terminal(mu: Array, cov: Array) -> Array:
        return 3 * mu[1] + cov[2, 2]

    computed = pi.accumulated_costs(
        problem, jnp.asarray(start), means, covs, charged, running, terminal
    )
    for i in range(N):
        path = [start, *means[:, :, i]]
        total = terminal(path[-1], covs[-1])
        for k in range(H):
            for part in charged:
                mean = path[k] + part * (path[k + 1] - path[k])
                cov = covs[k] + part * (covs[k + 1] - covs[k])
                total += running(mean, cov) * DT / len(charged)
        np.testing.assert_allclose(computed[i], total, rtol=1e-12)


def test_a_receded_nominal_ends_without_control(rng):
    nominal = rng.normal(size=(4, 2)).astype(np.float32)
    np.testing.assert_array_equal(pi.shifted(nominal), np.vstack([nominal[1:], np.zeros((1, 2))]))


def test_normals_are_standard(x64):
    plain = pi.normals(jax.random.key(0), (20, 2, 500), antithetic=False)
    assert_covariance(np.moveaxis(np.asarray(plain), 1, -1).reshape(-1, 2), np.eye(2))


def test_matched_increments_have_the_covariance_lambda_r_inverse_over_dt(x64, rng):
    """Unit vectors in place of the normals: the increments are the columns of the factor itself."""
    R = random_spd(rng, 2, 0.05, 1.0)
    temperature = 0.7
    problem = light_dark_problem(cost={"control_weight": R})
    units = jnp.eye(2)[None]
    factor = pi.matched_increments(problem, units, temperature, None)[0]
    np.testing.assert_allclose(factor @ factor.T, temperature * np.linalg.inv(R) / DT, rtol=1e-12)
    G = problem.system.G(jnp.zeros(4))
    matched = temperature * G @ np.linalg.inv(R) @ G.T
    np.testing.assert_allclose(G @ factor @ factor.T @ G.T * DT, matched, rtol=1e-12)
    np.testing.assert_array_equal(
        pi.matched_increments(problem, units, temperature, 2.75)[0], 2.75 * np.eye(2)
    )


def test_the_exact_girsanov_weight_is_williams_formula_at_alpha_zero(x64):
    """For S_u = lambda R^-1 / dt; gamma = lambda (1 - alpha) scales it down to nothing."""
    problem = light_dark_problem(cost={"control_weight": [0.05, 0.05]})
    temperature = 3.0
    exact = pi.girsanov_weight(problem, temperature, None, None)
    np.testing.assert_allclose(exact, 0.05 * DT * np.eye(2), rtol=1e-14)
    deviation = np.sqrt(temperature / 0.05 / DT)
    np.testing.assert_allclose(
        pi.girsanov_weight(problem, temperature, deviation, None), exact, rtol=1e-14
    )
    for alpha in (0.0, 0.3, 1.0):
        computed = pi.girsanov_weight(problem, temperature, deviation, alpha)
        np.testing.assert_allclose(computed, (1 - alpha) * exact, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        pi.girsanov_weight(problem, 2.0, 4.0, 0.5), 2.0 * 0.5 / 16 * np.eye(2), rtol=1e-14
    )


def test_girsanov_term_equals_a_loop(x64, rng):
    nominal = rng.normal(size=(5, 2))
    increments = rng.normal(size=(5, 2, 7))
    W = random_spd(rng, 2)
    computed = pi.girsanov(nominal, increments, W)
    for i in range(7):
        np.testing.assert_allclose(
            computed[i], sum(nominal[k] @ W @ increments[k, :, i] for k in range(5)), rtol=1e-12
        )


def test_weights_are_the_boltzmann_weights(x64, rng):
    costs = rng.normal(size=50)
    expected = np.exp(-costs / 0.7)
    np.testing.assert_allclose(pw.weights(costs, 0.7), expected / expected.sum(), rtol=1e-12)
    np.testing.assert_allclose(pw.weights(costs + 123.0, 0.7), pw.weights(costs, 0.7), rtol=1e-11)


@pytest.mark.parametrize(
    ("costs", "expected"),
    [
        ([1e8, 1e8 + 800, 1e9], [1, 0, 0]),
        ([-1e8, 0.0, 0.0], [1, 0, 0]),
        ([1e8] * 4, [0.25] * 4),
        ([0.0] * 4, [0.25] * 4),
        ([np.inf, 3.0, 3.0, np.inf], [0, 0.5, 0.5, 0]),
        ([3e38, -3e38, 0.0], [0, 1, 0]),
        ([7.0], [1]),
    ],
)
def test_weights_of_huge_equal_and_infinite_costs_in_float32(costs, expected):
    np.testing.assert_allclose(pw.weights(jnp.array(costs), 1.0), expected, rtol=1e-6)


def test_effective_sample_size_runs_from_one_to_all():
    assert pw.effective_sample_size(jnp.array([0.0, 1.0, 0.0])) == 1
    np.testing.assert_allclose(pw.effective_sample_size(jnp.full(8, 1 / 8)), 8)
    np.testing.assert_allclose(pw.effective_sample_size(jnp.array([0.5, 0.5, 0, 0])), 2)


def test_weighted_increments_average_over_the_samples(x64, rng):
    w = rng.dirichlet(np.ones(6))
    increments = rng.normal(size=(4, 2, 6))
    expected = sum(w[i] * increments[:, :, i] for i in range(6))
    np.testing.assert_allclose(pw.weighted_increments(w, increments), expected, rtol=1e-12)


def test_log_desirability_is_the_log_of_the_mean_weight(x64, rng):
    costs = rng.normal(size=30)
    np.testing.assert_allclose(
        pw.log_desirability(costs, 0.7), np.log(np.mean(np.exp(-costs / 0.7))), rtol=1e-12
    )
    np.testing.assert_allclose(pw.log_desirability(costs + 1e8, 0.7), -1e8 / 0.7, rtol=1e-6)


@quick_jit
def costs_of_means(problem: mb.Problem, start: Array, means: Array) -> Array:
    """S (N,) with q and phi taken at the mean."""
    cost = problem.cost

    def running(mu: Array, cov: Array) -> Array:
        return cost.base(mu)

    def terminal(mu: Array, cov: Array) -> Array:
        return cost.terminal(mu)

    return pi.accumulated_costs(
        problem, start, means, jnp.zeros((len(means) + 1, 1, 1)), (0.0,), running, terminal
    )


def assert_desirability(
    problem: mb.Problem, s: Scalar, means: Array, correction: Array | float
) -> None:
    """The Monte Carlo estimate of eq. (17) agrees with the exact Gaussian integral, to a standard
    error of 1 %.
    """
    costs = costs_of_means(problem, jnp.array([s.mean]), means) + correction
    steps = problem.steps
    dt = problem.dt
    exact = reference.gaussian_paths(
        s.a, s.b, s.diffusion, s.q, s.q_T, s.mean, dt, steps, s.temperature
    ).log_psi
    values = np.exp(-np.asarray(costs) / s.temperature)
    error = values.std() / values.mean() / np.sqrt(len(values))  # of the log of the mean
    assert error < 0.01
    assert abs(pw.log_desirability(costs, s.temperature) - exact) < SIGMAS * error


def test_feynman_kac_desirability_equals_the_exact_gaussian_integral(scalar, x64):
    """Linear drift, quadratic costs: E exp(-S / lambda) over ten Gaussian increments of the belief
    mean.
    """
    problem = scalar.problem(10)
    shape = (10, 1, 100_000)
    push = jnp.sqrt(scalar.diffusion * problem.dt) * jax.random.normal(jax.random.key(3), shape)
    means = rollouts(problem, jnp.array([scalar.mean]), jnp.zeros(shape), push)
    assert_desirability(problem, scalar, means, 0.0)


def test_the_girsanov_term_makes_the_desirability_independent_of_the_nominal(scalar, x64):
    """About a nominal u, the density of the samples is paid for by sum u' R delta dt + 1/2 u' R u
    dt.
    """
    problem = scalar.problem(10)
    shape = (10, 1, 100_000)
    nominal = jnp.linspace(-1.2, 0.5, 10)[:, None]
    deviation = jnp.sqrt(scalar.temperature / scalar.R / problem.dt)
    delta = deviation * jax.random.normal(jax.random.key(4), shape)
    means = rollouts(problem, jnp.array([scalar.mean]), nominal[:, :, None] + delta)
    weight = problem.cost.R * problem.dt
    correction = pi.girsanov(nominal, delta, weight) + 0.5 * jnp.sum(nominal**2 * weight)
    assert_desirability(problem, scalar, means, correction)


def test_a_path_that_diverged_weighs_nothing_nor_does_any_in_a_hopeless_step():
    w = pw.weights(jnp.array([1.0, jnp.nan, jnp.inf, 1.0]), 1.0)
    np.testing.assert_allclose(w, [0.5, 0, 0, 0.5], rtol=1e-6)
    np.testing.assert_array_equal(pw.weights(jnp.array([jnp.inf, jnp.nan]), 1.0), 0)
    assert pw.effective_sample_size(jnp.zeros(2)) == 0


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
def test_alpha_means_the_same_for_the_exact_spread_given_or_not(alpha, scalar, x64):
    problem = scalar.problem()
    exact = np.sqrt(scalar.temperature / scalar.R / problem.dt)
    named = pi.girsanov_weight(problem, scalar.temperature, exact, alpha)
    np.testing.assert_allclose(
        pi.girsanov_weight(problem, scalar.temperature, None, alpha), named, rtol=1e-10
    )


@pytest.mark.parametrize("block", [4, 100])
def test_no_path_of_any_block_weighs_anything_if_no_cost_is_finite(block, monkeypatch, x64):
    monkeypatch.setattr(pw, "BLOCK", block)

    def sample(key: Array, n: int) -> pw.CostedPaths:
        return pw.CostedPaths(jnp.ones((2, 1, n)), jnp.full(n, jnp.nan), jnp.zeros((2, 3, n)))

    nominal = jnp.full((2, 1), 0.3)
    improved = pw.improve(nominal, sample, jax.random.key(0), 9, pw.Exponential(1.0))
    np.testing.assert_array_equal(improved.weights, np.zeros(9))
    np.testing.assert_array_equal(improved.controls, nominal)


@pytest.mark.parametrize("block", [4, 100])
def test_paths_without_a_finite_cost_weigh_nothing_in_any_block(block, monkeypatch, x64):
    monkeypatch.setattr(pw, "BLOCK", block)
    bad = jnp.array([jnp.nan, jnp.inf, -jnp.inf, 0.0])

    def sample(key: Array, n: int) -> pw.CostedPaths:
        costs = jax.random.uniform(key, (n,)) + jnp.tile(bad, 3)[:n]
        return pw.CostedPaths(jnp.ones((2, 1, n)), costs, jnp.zeros((2, 3, n)))

    nominal = jnp.zeros((2, 1))
    weighting = pw.Exponential(0.5)
    change, w, _ = pw.improve(nominal, sample, jax.random.key(0), 12, weighting)
    np.testing.assert_array_equal(np.asarray(w).reshape(3, 4)[:, :3], 0)
    assert np.all(np.asarray(w).reshape(3, 4)[:, 3] > 0)
    np.testing.assert_allclose(np.sum(w), 1, rtol=1e-12)
    np.testing.assert_allclose(change, 1, rtol=1e-12)
