"""The command lines that make the numbers of a report again."""

import shlex
from dataclasses import dataclass

from fembridge.validation.judged_model import JudgedModel
from fembridge.validation.study import Study

_STORED = "# TouchSim: its rates are stored, see fembridge/touchsim/README.md"


@dataclass(frozen=True, slots=True)
class CommandLines:
    """`whole` makes the report; the others make parts of it, each into a folder."""

    whole: str
    finger: str
    models: tuple[JudgedModel, ...]

    def simulations(self, stimuli: str) -> tuple[str, ...]:
        """Give a line for each model that fires it under `stimuli`."""
        return tuple(
            shlex.join(
                (
                    *("fembridge", "simulate", "--stimulus", stimuli),
                    *("--finger", self.finger, "--stored"),
                    *("--parameters", model.word),
                    *("--preindent-um", f"{model.preindent_um:g}"),
                    *("-o", f"{model.name}_{stimuli.partition(',')[0]}"),
                )
            )
            for model in self.models
        )

    def rates(self, stimuli: str) -> tuple[str, ...]:
        """Give the lines behind rates of `stimuli` from every source."""
        return (self.whole, *self.simulations(stimuli), _STORED)

    def deflections(self) -> tuple[str, ...]:
        """Give the lines behind the skin's profile."""
        return (
            self.whole,
            "fembridge deflect --stored -o deflection",
            "fembridge deflect --finger quick --solver run -o deflection_solved",
        )


def command_lines(study: Study, whole: str) -> CommandLines:
    """Give the lines of `study`, which the command `whole` made."""
    return CommandLines(whole, study.finger, study.models)
