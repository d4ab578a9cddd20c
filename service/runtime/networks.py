"""The networks of a service: its image encoders, and the one that removes backgrounds."""

from dataclasses import dataclass

from service.encoding.matting import Matting
from service.encoding.registry import Models
from service.settings import Settings


@dataclass(frozen=True)
class Networks:
    """Opened networks; `matting` is None if no matting model is set."""

    models: Models
    matting: Matting | None

    @classmethod
    def open(cls, settings: Settings) -> "Networks":
        """Load the files that the settings name. Raises InvalidModel."""
        models = Models.open(settings.model, settings.threads)
        return cls(models, Matting.of(settings.matting_model, settings.threads))

    def warm_up(self) -> None:
        """Run one inference of each encoder; then free the memory of all networks but the default encoder."""
        self.models.warm_up()
        self.models.rest()
        if self.matting:
            self.matting.rest()
