"""The closure `fokker_planck` refuses what it cannot answer before it has done most of its work."""

import pytest

from harvester.averaging import flow, solution
from harvester.averaging.closures import average
from harvester.averaging.of_scene import averaged_device
from harvester.base.errors import AveragingError
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["piezo.coupling=100"], "half widths of its density, and the limit of fokker_planck is 2"),
        (["load.decay_rate=1e-4"], "jumps between the wells are as slow"),
        (["excitation.correlation_time=100"], "mean square voltage is negative"),
        (["excitation.correlation_time=50", "excitation.intensity=0.05"], "is negative"),
    ],
)
def test_refused_with_a_fifth_of_the_work_at_most(overrides, words, monkeypatch):
    scene = Scene.read("paper", overrides).replace({"excitation.knot_spacing": None})
    work = []

    def counted(task, more, ahead=0.0):
        work.append(more)
        return taken(task, more, ahead)

    taken = solution.StationaryProblem.take
    monkeypatch.setattr(solution.StationaryProblem, "take", counted)
    with pytest.raises(AveragingError, match=words) as caught:
        average(averaged_device(prepared(scene)))
    assert sum(work) < 0.2 * solution.MOST_WORK
    assert "\n" not in str(caught.value)


def test_paths_are_sampled_before_all_are_followed(monkeypatch):
    """A grid whose paths are too long is refused once a few of them are known."""
    followed = []

    def noted(device, x, z, v, *rest):
        followed.append(x.size * z.size * v.size)
        return ends(device, x, z, v, *rest)

    ends = flow._ends
    monkeypatch.setattr(flow, "_ends", noted)
    monkeypatch.setattr(flow, "MOST_OF_ALL_PATHS", 100.0)
    with pytest.raises(AveragingError, match="so stiff"):
        average(averaged_device(prepared(Scene.read("paper"))))
    assert len(followed) == 1
    assert followed[0] < 200
