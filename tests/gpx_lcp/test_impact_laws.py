"""Impact laws on single collisions: what each promises, what it does not, and answers known on paper."""

import itertools

import numpy as np
import pytest

import gpx_lcp as gpx
from benchmarks.impacts.collisions import DoublePendulum, random_bodies, random_linkage

LAWS = tuple(gpx.LAWS)


def chain(masses, velocities, elasticity=2.0):
    """Balls on a line that meet one pair after the other, the hindmost first: velocities after the last meeting."""
    v = np.array(velocities, dtype=float)
    while (closing := np.flatnonzero(v[:-1] - v[1:] > 1e-14)).size:
        k = closing[0]
        impulse = gpx.two_body_impulse(masses[k : k + 2], v[k : k + 2], elasticity=(elasticity, elasticity))
        v[k : k + 2] += np.array([-impulse, impulse]) / masses[k : k + 2]
    return v


def line(masses, velocities):
    """A row of point masses that touch, one velocity each."""
    jacobian = np.diff(np.eye(len(masses)), axis=0)
    v = np.array(velocities, dtype=float)
    return gpx.StackedSystem.from_jacobian(
        jacobian, 1.0 / np.asarray(masses), -jacobian @ v, np.zeros(len(v) - 1), free_velocity=v
    )


def one_contact(normal, tangential, friction):
    """A ball of 1 kg on a wall: A is 1 along the normal and 7/2 along the tangents."""
    return gpx.StackedSystem(np.diag([1.0, 3.5, 3.5]), [-normal, -tangential, 0.0], [friction])


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("elasticity", [1.0, 1.4, 2.0])
def test_two_bodies_are_the_founding_formula(law, elasticity):
    masses, v = (1.0, 3.0), (2.0, -1.0)
    found = gpx.impact(line(masses, v), law, elasticity=elasticity)
    expected = gpx.two_body_impulse(masses, v, elasticity=(elasticity, elasticity))
    assert found.impulse.ravel() == pytest.approx([expected], rel=1e-9)
    assert found.status is gpx.Status.SOLVED
    assert found.method.startswith(f"{law} impact, ")


@pytest.mark.parametrize("n", range(2, 8))
def test_sequential_cradle_passes_everything_on_to_the_last_ball(n):
    found = gpx.impact(gpx.scenes.cradle(n), "sequential")
    assert found.velocities[:, 0] == pytest.approx([0.0] * (n - 1) + [1.0], abs=1e-12)
    assert found.extras["passes"] == n - 1


@pytest.mark.parametrize("n", range(2, 8))
@pytest.mark.parametrize("law", ["newton", "poisson"])
def test_stacked_cradle_is_the_answer_of_one_program(law, n):
    found = gpx.impact(gpx.scenes.cradle(n), law)
    assert found.velocities[:, 0] == pytest.approx([-(n - 2) / n] + [2 / n] * (n - 1), abs=1e-9)


def test_energy_safe_cradle_loses_energy_as_its_law_says():
    found = gpx.impact(gpx.scenes.cradle(3), "energy_safe")
    assert found.velocities[:, 0] == pytest.approx([-1 / 6, 1 / 3, 5 / 6], abs=1e-9)
    assert found.energy_change == pytest.approx(-1 / 12, abs=1e-9)


@pytest.mark.parametrize("masses", [(1, 2, 3), (3, 2, 1), (1, 5, 1), (1, 2, 1, 2, 1, 2, 1)])
def test_sequential_is_one_meeting_after_the_other_where_only_one_pair_closes(masses):
    """In these rows no two pairs that share a ball ever close at once, so that pairwise meetings are the answer."""
    masses = np.array(masses, dtype=float)
    v = np.eye(len(masses))[0]
    found = gpx.impact(gpx.scenes.cradle(len(masses), masses=masses), "sequential")
    assert found.velocities[:, 0] == pytest.approx(chain(masses, v), abs=1e-9)
    assert abs(found.energy_change) < 1e-9


@pytest.mark.parametrize("law", ["newton", "poisson", "sequential"])
def test_break_shot_is_symmetric_and_keeps_its_energy(law):
    v = gpx.impact(gpx.scenes.break_shot(), law).velocities
    side = np.sqrt(3) / 5
    assert v[:, :2] == pytest.approx(np.array([[-0.2, 0], [0.6, side], [0.6, -side]]), abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("tangential", [1.0, 1.5, 2.0])
def test_superball_turns_round_with_its_tangential_elasticity(law, tangential):
    """The contact point leaves with -(e_t - 1) of its velocity -r ω: v = 2/7 e_t r ω and ω' = (1 - 5/7 e_t) ω."""
    found = gpx.impact(gpx.scenes.superball(10.0, tangential_elasticity=tangential), law)
    assert found.velocities[0] == pytest.approx(
        [2 / 7 * tangential * 5, 0, 2, 0, (1 - 5 / 7 * tangential) * 10, 0], abs=1e-8
    )
    assert found.energy_change <= 1e-9
    if tangential == 2.0:
        assert found.energy_change == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("law", LAWS)
def test_friction_bounds_what_tangential_elasticity_reverses(law):
    found = gpx.impact(one_contact(-1.0, 5.0, 0.1), law, elasticity=1.5, tangential_elasticity=2.0)
    assert found.impulse[0] == pytest.approx([1.5, -0.15, 0.0], abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_plastic_rocking_block_goes_on_as_housner_says(law):
    found = gpx.impact(gpx.scenes.rocking_block(), law)
    assert found.velocities[0, 4] == pytest.approx(0.85, abs=1e-8)


def test_kanes_pendulum_gains_energy_by_newtons_law_and_the_certificate_says_so():
    pendulum = DoublePendulum.striking()
    before = pendulum.energy(pendulum.system.free_velocity)
    found = {law: gpx.impact(pendulum.system, law, elasticity=1.5) for law in LAWS}
    change = {law: pendulum.energy(impact.velocities) - before for law, impact in found.items()}
    assert change["newton"] > 0.5 * before
    assert found["newton"].certificate.energy_change > 0.3
    for law in ("poisson", "energy_safe", "sequential"):
        assert change[law] < 0.0
        assert found[law].certificate.energy_change < 0.0
    for law in LAWS:
        assert found[law].energy_change == pytest.approx(change[law], abs=1e-15)
    closing = -found["newton"].system.B.reshape(-1, 2)[0, 0]
    for law in ("newton", "energy_safe"):
        assert found[law].contact_velocity[0, 0] == pytest.approx(-0.5 * closing, rel=1e-9)
    given = found["poisson"].solutions[0].impulse[0, 0]
    assert found["poisson"].impulse[0, 0] == pytest.approx(1.5 * given, rel=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_random_impacts_keep_momentum_and_end_without_closing(law):
    for seed in range(60):
        bodies = random_bodies(seed)
        before = bodies.system.free_velocity
        found = bodies.impact(law)
        assert found.status is gpx.Status.SOLVED
        assert bodies.momenta(found.velocities).changed_from(bodies.momenta(before)) < 1e-14
        assert found.energy_change == pytest.approx(bodies.energy(found.velocities) - bodies.energy(before), abs=1e-11)
        assert found.certificate.penetration_velocity < 1e-8
        assert found.certificate.cone_violation < 1e-8
        if law == "energy_safe":
            assert found.energy_change <= 0.0


@pytest.mark.parametrize("law", ["poisson", "energy_safe", "sequential"])
def test_without_friction_no_energy_is_gained(law):
    for seed in range(40):
        bodies = random_bodies(seed, friction=False, reversal=False)
        assert bodies.impact(law).energy_change <= 1e-10 * bodies.energy(bodies.system.free_velocity)


@pytest.mark.parametrize("law", LAWS)
def test_without_friction_and_separating_contacts_no_law_gains_energy(law):
    solved = 0
    for seed in range(40):
        rough, elasticity, _ = random_linkage(seed)
        normals = rough.jacobian.toarray()[::2]
        v = rough.free_velocity
        system = gpx.StackedSystem.from_jacobian(
            normals, np.ones(v.size), -normals @ v, np.zeros(len(normals)), free_velocity=v
        )
        found = gpx.impact(system, law, elasticity=elasticity)
        if found.status is gpx.Status.SOLVED:  # newton asks for the impossible of some
            solved += 1
            assert found.energy_change <= 1e-9 * 0.5 * float(v @ v)
    assert solved >= 30


def test_newton_is_solved_or_refuted_on_linkages():
    """Its B may ask for what no impulses give: then no way of the contacts has a point, and that is said."""
    seen = set()
    for seed in range(60):
        system, elasticity, tangential = random_linkage(seed)
        found = gpx.impact(system, "newton", elasticity=elasticity, tangential_elasticity=tangential)
        seen.add(found.status)
        if found.status is gpx.Status.INFEASIBLE:
            proof = found.solutions[0].extras["refutation"]
            assert proof.margin > 1e-4
            assert found.residual > 1e-4
    assert seen == {gpx.Status.SOLVED, gpx.Status.INFEASIBLE}


def test_energy_safe_never_gains_where_the_others_do():
    """Linkages: few coordinates and several rough contacts, all closing, with tangential elasticity."""
    worst = dict.fromkeys(LAWS, 0.0)
    for seed in range(120):
        system, elasticity, tangential = random_linkage(seed)
        size = 0.5 * float(system.free_velocity @ system.free_velocity)
        for law in ("newton", "energy_safe"):
            found = gpx.impact(system, law, elasticity=elasticity, tangential_elasticity=tangential)
            worst[law] = max(worst[law], found.energy_change / size)
    assert worst["newton"] > 0.1
    assert worst["energy_safe"] == 0.0


@pytest.mark.parametrize("law", LAWS)
def test_a_common_velocity_changes_no_outcome(law):
    """Balls of different elasticity, the default rule: the impulses do not depend on who looks on."""
    outcomes = []
    for added in ((0, 0, 0), (3, -2, 1)):
        scene = gpx.Scene(gravity=(0, 0, 0))
        for k, (mass, elasticity) in enumerate(((1.0, 2.0), (3.0, 1.2), (0.5, 1.6))):
            velocity = np.array([1.0 - k, 0.2 * k, 0.0]) + added
            material = gpx.Material(0.3, elasticity, tangential_elasticity=1.5)
            scene.add_rigid(gpx.Sphere(0.5), mass, position=(k, 0, 0), velocity=velocity, material=material)
        moving = gpx.impact(scene, law, tolerance=1e-13).velocities
        outcomes.append(moving - np.array([*added, 0, 0, 0]))
    assert np.abs(outcomes[0] - outcomes[1]).max() < 1e-12


@pytest.mark.parametrize("law", LAWS)
def test_elasticity_acts_above_the_impact_speed_only(law):
    slow = gpx.impact(line((1.0, 1.0), (1.0, 0.0)), law, elasticity=2.0, impact_speed=1.0)
    fast = gpx.impact(line((1.0, 1.0), (1.0, 0.0)), law, elasticity=2.0, impact_speed=0.99)
    assert slow.velocities == pytest.approx([0.5, 0.5], abs=1e-9)
    assert fast.velocities == pytest.approx([0.0, 1.0], abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_contacts_that_separate_are_left_alone(law):
    found = gpx.impact(line((1.0, 1.0, 1.0), (0.0, 1.0, 3.0)), law, elasticity=2.0)
    assert found.velocities.tolist() == [0.0, 1.0, 3.0]
    assert found.energy_change == 0.0


def test_inelastic_collapse_ends_in_rest():
    """A ball on a wall, and three behind it, all closing: restitution 0.05 needs many passes, then all are at rest."""
    jacobian = np.vstack((np.eye(4)[0], np.diff(np.eye(4), axis=0)))
    v = -np.ones(4)
    system = gpx.StackedSystem.from_jacobian(jacobian, np.ones(4), -jacobian @ v, np.zeros(4), free_velocity=v)
    found = gpx.impact(system, "sequential", elasticity=1.05, impact_speed=1e-3)
    assert found.status is gpx.Status.SOLVED and 1 < found.extras["passes"] < 500
    assert 0.0 <= found.velocities.min() + 1e-12 and np.abs(found.velocities).max() < 2e-3


def test_sequential_says_when_it_is_cut_short(monkeypatch):
    monkeypatch.setattr("gpx_lcp.impact_laws.sequential.PASSES", 2)
    found = gpx.impact(gpx.scenes.cradle(5), "sequential")
    assert found.status is gpx.Status.MAX_ITERATIONS
    assert np.diff(found.velocities[:, 0]).min() > -1e-10  # as tightly as its programs are solved


def test_energy_safe_that_does_not_end_falls_back_to_the_scaled_plastic_impulses(monkeypatch):
    monkeypatch.setattr("gpx_lcp.impact_laws.energy_safe.PASSES", 1)
    found = gpx.impact(gpx.scenes.cradle(3), "energy_safe")
    assert found.status is gpx.Status.MAX_ITERATIONS
    assert found.energy_change <= 0.0
    assert found.velocities[:, 0] == pytest.approx([-1 / 3, 2 / 3, 2 / 3], abs=1e-9)


def test_a_system_that_carries_A_alone_collides_too():
    found = gpx.impact(gpx.StackedSystem(np.eye(1), [2.0], [0.0]), elasticity=[1.5])
    assert found.velocities is None
    assert found.contact_velocity.tolist() == [[1.0]]
    assert found.energy_change == pytest.approx(-1.5)


def test_point_masses_in_a_scene_collide_without_turning():
    scene = gpx.Scene()
    material = gpx.Material(0.5, 2.0)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_point_mass(2.0, position=(0, 0, 0.5), velocity=(1, 0, -1), shape=gpx.Sphere(0.5), material=material)
    found = gpx.impact(scene)
    assert found.velocities.tolist()[0] == pytest.approx([0, 0, 1, 0, 0, 0], abs=1e-9)
    assert gpx.impact(gpx.Scene()).velocities.shape == (0, 6)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (dict(collision="balls"), gpx.ProblemError, "collision is a str: a Scene or a StackedSystem is needed"),
        (dict(law="hertz"), gpx.SettingsError, "law is 'hertz': it must be one of 'newton', 'poisson'"),
        (dict(elasticity=2.5), gpx.ProblemError, r"elasticity\[0\] is 2.5: it must lie between 1 .* and 2"),
        (dict(elasticity=[1.0, 1.0]), gpx.ProblemError, r"elasticity has shape \(2,\), but \(1,\) is needed"),
        (dict(tangential_elasticity=0.5), gpx.ProblemError, r"tangential_elasticity\[0\] is 0.5"),
        (dict(impact_speed=-1.0), gpx.SettingsError, "impact_speed is -1.0: it must be a number of m/s"),
        (dict(tolerance=0.0), gpx.SettingsError, "tolerance is 0.0: it must be a positive number"),
        (dict(collision=gpx.scenes.cradle(2), elasticity=2.0), gpx.ProblemError, "elasticity is given beside a scene"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else None,
)
def test_a_wrong_question_is_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        gpx.impact(**{"collision": line((1.0, 1.0), (1.0, 0.0)), **arguments})


def test_a_system_with_gravity_in_its_B_is_no_collision():
    system = gpx.World(gpx.scenes.tower(1), 1 / 240).system()
    gpx.impact(system)
    right = line((1.0, 1.0), (1.0, 0.0))
    wrong = gpx.StackedSystem.from_jacobian(
        right.jacobian, right.inverse_mass, 2.0 * right.B, [0.0], free_velocity=right.free_velocity
    )
    with pytest.raises(gpx.ProblemError, match=r"B\[0\] is 2, but -J v is 1: an impact needs the B of a plastic"):
        gpx.impact(wrong)


def test_every_law_is_in_the_table_by_its_own_name():
    assert LAWS == ("newton", "poisson", "energy_safe", "sequential")
    for name, law in gpx.LAWS.items():
        assert law.name == name and law.summary and law.promises and law.breaks
    assert [law.name for law in gpx.LAWS.values() if law.in_core] == ["newton"]
    assert len({law.run for law in itertools.chain(gpx.LAWS.values())}) == len(LAWS)
