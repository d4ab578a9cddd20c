"""Calls about the service itself: models, probes, metrics."""

from hof_client.answers import Health, Model, ModelList
from hof_client.bodies import Whole, json_reader
from hof_client.request import Call, Request


def models() -> Call[ModelList]:
    """Return the loaded models; the first is the default."""
    return Call(Request("GET", "/models"), json_reader(ModelList))


def model(model: str | None = None) -> Call[Model]:
    """Return a model with its card and spec; by default the first."""
    return Call(Request("GET", "/model", query={"model": model}), json_reader(Model))


def live() -> Call[Health]:
    """Show that the process answers."""
    return Call(Request("GET", "/health/live"), json_reader(Health))


def ready() -> Call[Health]:
    """Show that the service can serve. Raises NotReady, after as many repeats as the client allows."""
    return Call(Request("GET", "/health/ready"), json_reader(Health))


def metrics() -> Call[str]:
    """Return the metrics in Prometheus's text format."""
    return Call(Request("GET", "/metrics", media_type="text/plain"), lambda _: Whole(bytes.decode))
