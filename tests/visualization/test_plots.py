"""Plots: what is drawn is what the log holds, and no legend covers it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from phcontrol import (
    InvalidArgumentError,
    MechanicalSystem,
    MinimumJerk,
    UnknownNameError,
    compare,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.visualization.plots import joints_legend


@pytest.fixture(scope="module")
def run():
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"))
    goal = system.robot.near_home()
    way = MinimumJerk.within_limits(system.robot, system.robot.home, goal)
    return simulate(system, make_controller("energy_shaping", system, reference=way), duration=6.0, dt=0.01)


def lines(axes):
    return [line for line in axes.lines if len(line.get_xdata()) > 2]


def drawn(axes, every=1):
    return np.array([line.get_ydata() for line in lines(axes)[::every]]).T


def test_each_plot_draws_the_log_and_returns_its_axes(run):
    robot = load_robot("pera_shoulder_elbow")
    axes = run.plot.position()
    assert axes.get_ylabel() == "q [rad]"
    np.testing.assert_array_equal(drawn(axes, every=2), run.position)
    errors = np.maximum(np.abs(robot.difference(run.position, run.goal)), 1e-16)
    np.testing.assert_array_equal(drawn(run.plot.error()), errors)
    np.testing.assert_array_equal(drawn(run.plot.torque()), run.torque)
    np.testing.assert_array_equal(drawn(run.plot.torque(limits=True)), run.torque / robot.effort_limit)
    np.testing.assert_array_equal(drawn(run.plot.velocity()), run.velocity / robot.velocity_limit)
    own = Figure().subplots()
    assert run.plot.energy(own) is own
    kinetic = own.lines[1].get_ydata()
    seen = np.isfinite(kinetic)
    assert seen.sum() > 50
    np.testing.assert_array_equal(kinetic[seen], run.kinetic_energy[seen])


def test_every_joint_has_its_name_and_the_names_fit(run):
    """A plot by itself has a legend below, in columns that fit; into given axes the names go with the lines."""
    names = list(run.metadata["joint_names"])
    for draw in (run.plot.position, run.plot.error, run.plot.velocity, run.plot.torque):
        own = Figure(figsize=(4.0, 7.0), layout="constrained").subplots()
        assert draw(own).get_legend_handles_labels()[1] == names
        assert own.figure.legends == []
        assert [text.get_text() for text in draw().figure.legends[0].texts] == names
    narrow = Figure(figsize=(4.0, 5.0), layout="constrained")
    joints_legend(narrow, SimpleNamespace(metadata={"joint_names": [f"panda_joint{k}" for k in range(1, 8)]}))
    canvas = FigureCanvasAgg(narrow)
    canvas.draw()
    box = narrow.legends[0].get_window_extent(canvas.get_renderer())
    assert box.x0 >= 0.0
    assert box.x1 <= narrow.bbox.width


def test_the_arm_is_drawn_from_two_sides(run):
    robot = load_robot("pera_shoulder_elbow")
    tool = robot.placement("tool", run.goal[-1]).translation
    for seen_from, height in (("the side", 2), ("above", 1)):
        goal = run.plot.posture(seen_from=seen_from).lines[-1]
        np.testing.assert_allclose([goal.get_xdata()[-1], goal.get_ydata()[-1]], [tool[0], tool[height]], atol=1e-12)
    with pytest.raises(UnknownNameError, match="seen_from"):
        run.plot.posture(seen_from="below")


def test_the_time_axis_ends_when_things_end_and_legends_cover_nothing(run):
    figure = run.plot()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    moving = run.time[np.abs(run.velocity).max(axis=1) > 1e-3 * np.abs(run.velocity).max()][-1]
    (positions,) = [axes for axes in figure.axes if axes.get_title().startswith("joint positions")]
    assert moving < positions.get_xlim()[1] < run.time[-1]
    plots = [axes.get_window_extent(renderer) for axes in figure.axes]
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    assert len(legends) == 2
    for legend in legends:
        box = legend.get_window_extent(renderer)
        assert not any(box.overlaps(plot.shrunk(0.98, 0.98)) for plot in plots)


def test_runs_are_compared(run):
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"))
    other = simulate(system, make_controller("force_feedback", system), duration=0.2)
    figure = compare({"one": run, "other": other}, "two runs")
    np.testing.assert_array_equal(figure.axes[2].lines[1].get_ydata(), other.storage)
    hand = system.robot.placement("tool", other.position[-1]).translation
    np.testing.assert_allclose(figure.axes[3].lines[1].get_xydata()[-1], hand[[0, 2]], atol=1e-12)
    assert [text.get_text() for text in figure.legends[0].texts] == ["one", "other"]
    with pytest.raises(InvalidArgumentError, match="at least one"):
        compare({})
    foreign = MechanicalSystem(load_robot("pera_shoulder"))
    with pytest.raises(InvalidArgumentError, match="'foreign' is of the joints"):
        compare({"run": run, "foreign": simulate(foreign, make_controller("energy_shaping", foreign), duration=0.1)})
