"""Times our controllers with a chosen number of samples, `ce-2000`, for `benchmarks/scale.py`."""

from plant import Workload
from subjects.ours import Controller


def make(name: str, workload: Workload, dtype: str) -> "Scaled":
    """Returns the controller and number of samples of a name."""
    controller, _, n_samples = name.partition("-")
    return Scaled(controller, int(n_samples), workload, dtype)


class Scaled(Controller):
    """Measures the time of a controller of `conf/controller` and nothing else.

    Its memory is then that of one program.
    """

    def __init__(self, controller: str, n_samples: int, workload: Workload, dtype: str) -> None:
        super().__init__(controller, workload, dtype)
        self.config["controller"]["n_samples"] = n_samples

    def closed_loop(self) -> dict[str, float]:
        return {}
