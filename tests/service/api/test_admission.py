"""Gates that routes declare."""

from service.api.admission import declared_gates
from service.api.app import ROUTERS
from service.runtime.admission import Gates
from service.settings import Settings


def test_declared_gates_of_all_routes_are_those_of_calls_that_always_compute(settings: Settings) -> None:
    gates = Gates.of(settings)
    declared = declared_gates((route for router in ROUTERS for route in router.routes), gates)
    assert declared == {
        ("POST", "/encode"): gates.images,
        ("POST", "/v2/models/{name}/infer"): gates.images,
        ("POST", "/v2/models/{name}/versions/{version}/infer"): gates.images,
        ("POST", "/objects"): gates.points,
        ("POST", "/compose"): gates.points,
        ("POST", "/objects/{id}/path"): gates.points,
    }
