"""An excitation of a test: white noise by its height."""

from harvester.device.keys import positive, table
from harvester.excitation.base import Excitation
from harvester.excitation.correlated_normals import NormalPath


@table
class Steps(Excitation):
    """A toy kind: what the recipe in CONTRIBUTING asks for, and no more."""

    height: float = positive("height", "m/s²", required=True)
    kind: str = "steps"
    knot_spacing: float | None = None

    def spacing(self, longest):
        return longest

    def equivalent_noise(self, relaxation_time, longest):
        return self.height**2 * relaxation_time, relaxation_time

    def path(self, spacing, length, seed):
        return NormalPath(seed, self.height / length, spacing=spacing)

    def notes(self, spacing, angular_frequency, run):
        return ()
