"""A prepared scene with other values, and the one that a task's function is given."""

from harvester.engines.task import compute
from harvester.excitation.sine import SteppedSine
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared


def test_other_values_and_tables_give_what_preparing_the_changed_scene_gives():
    scene = Scene.read("device")
    changes = {"oscillator.mass": 0.03, "run.duration": 7.0}
    heavier = prepared(scene).replace(changes)
    assert heavier == prepared(scene.replace(changes))
    assert heavier.system.damper.damping < prepared(scene).system.damper.damping
    # A sweep in steps is no kind of excitation that a scene's file may have.
    steps = SteppedSine(1.0, (5.0, 6.0), 2.0, 0.01)
    assert heavier.replace(excitation=steps).scene.excitation is steps


def told(prepared_scene, report, power):
    return prepared_scene.system.damper.damping**power


def test_the_function_of_a_task_is_given_its_scene_prepared():
    scene = Scene.read("device")
    arguments = {"scene": scene, "power": 1}
    answer, _ = compute(told, arguments, lambda share: None)
    assert answer == prepared(scene).system.damper.damping
    assert arguments["scene"] is scene
