"""The manifests of deploy/ fit the service: settings, probes, paths, bounds and image. No cluster is needed."""

import copy
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from service import __version__
from service.encoding.decode import WORKING_BYTES
from service.encoding.encoder import Encoder
from service.settings import MIB, Settings
from tests.project.image_size import LEFT_OUT, image_mb

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
DOCKERFILE = (ROOT / "Dockerfile").read_text("utf-8")
README = (DEPLOY / "README.md").read_text("utf-8")
MANIFESTS: dict[str, dict[str, Any]] = {
    path.name: yaml.safe_load(path.read_text("utf-8")) for path in DEPLOY.glob("*.yaml")
}
POD = MANIFESTS["deployment.yaml"]["spec"]["template"]
(CONTAINER,) = POD["spec"]["containers"]
POSTGRES_CONNECTIONS = 100 - 3  # max_connections less superuser_reserved_connections, by default
KUBERNETES = ("1.27", "1.37")  # the oldest and the newest version whose schemas are tried
RESOURCES = {name: manifest for name, manifest in MANIFESTS.items() if name != "kustomization.yaml"}
LABELS = {"app.kubernetes.io/name": "hof"}


def _default(name: str) -> float:
    return float(Settings.model_fields[name].default)


def _mib(quantity: str) -> float:
    units = {"Mi": 1, "Gi": 1024}
    return float(quantity[:-2]) * units[quantity[-2:]]


def test_manifest_is_applied_or_an_example() -> None:
    applied = MANIFESTS["kustomization.yaml"]["resources"]
    assert {*applied, "kustomization.yaml", "ingress.yaml"} == set(MANIFESTS)
    assert all(manifest["apiVersion"] and manifest["kind"] for manifest in MANIFESTS.values())


@pytest.mark.parametrize("version", KUBERNETES)
@pytest.mark.parametrize("name", RESOURCES)
def test_manifest_is_valid_by_the_schemas_of_kubernetes(name: str, version: str) -> None:
    kubernetes_validate.validate(RESOURCES[name], version, strict=True)


def _places(value: object, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Yield where the fields of a manifest are. Labels have any name, and so have resources."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if "/" not in key and path[-1:] not in (("limits",), ("requests",)):
                yield (*path, key)
                yield from _places(inner, (*path, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _places(inner, (*path, index))


@pytest.mark.parametrize("name", RESOURCES)
def test_manifest_with_a_misspelled_field_is_invalid(name: str) -> None:
    for path in _places(RESOURCES[name]):
        manifest = copy.deepcopy(RESOURCES[name])
        inner: Any = manifest
        for key in path[:-1]:
            inner = inner[key]
        inner[f"{path[-1]}s"] = inner.pop(path[-1])
        with pytest.raises((kubernetes_validate.ValidationError, KeyError)):  # KeyError: no kind, or no apiVersion
            kubernetes_validate.validate(manifest, KUBERNETES[-1], strict=True)


def test_image_tag_is_the_version() -> None:
    (image,) = MANIFESTS["kustomization.yaml"]["images"]
    assert (image["name"], image["newTag"]) == (CONTAINER["image"], __version__)
    assert f"docker build -t {image['newName']}:{__version__} ." in README


def test_variables_of_the_container_are_settings() -> None:
    names = {variable["name"] for variable in CONTAINER["env"]}
    mentioned = {name for path in DEPLOY.iterdir() for name in re.findall(r"HOF_[A-Z_]+", path.read_text("utf-8"))}
    assert names | mentioned <= {f"HOF_{name.upper()}" for name in Settings.model_fields}
    assert {"HOF_DATABASE_URL", "HOF_API_KEYS_FILE"} <= names


def test_pod_with_service_links_off_gets_no_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kubernetes sets NAME_PORT in every pod for each Service, unless the pod turns that off."""
    monkeypatch.setenv(f"{MANIFESTS['service.yaml']['metadata']['name'].upper()}_PORT", "tcp://10.0.0.1:80")
    assert Settings().port == 8080  # the service would do with the links, too
    assert POD["spec"]["enableServiceLinks"] is False


def test_secrets_are_mounted_where_the_service_reads_them() -> None:
    env = {variable["name"]: variable for variable in CONTAINER["env"]}
    mounts = {mount["name"]: mount["mountPath"] for mount in CONTAINER["volumeMounts"]}
    volumes = {volume["name"]: volume for volume in POD["spec"]["volumes"]}
    assert set(mounts) == set(volumes)
    (item,) = volumes["keys"]["secret"]["items"]
    assert env["HOF_API_KEYS_FILE"]["value"] == f"{mounts['keys']}/{item['path']}"
    source = env["HOF_DATABASE_URL"]["valueFrom"]["secretKeyRef"]
    assert source["name"] == volumes["keys"]["secret"]["secretName"]
    command = f"create secret generic {source['name']} --from-file={item['key']} --from-literal={source['key']}="
    assert command in README


def test_probes_and_metrics_are_paths_of_the_api() -> None:
    paths = json.loads((ROOT / "openapi.json").read_text("utf-8"))["paths"]
    probes = {kind: CONTAINER[f"{kind}Probe"]["httpGet"] for kind in ("startup", "liveness", "readiness")}
    assert {kind: probe["path"] for kind, probe in probes.items()} == {
        "startup": "/health/live",
        "liveness": "/health/live",
        "readiness": "/health/ready",
    }
    called = {probe["path"] for probe in probes.values()} | {POD["metadata"]["annotations"]["prometheus.io/path"]}
    assert called <= set(paths)


def test_port_is_that_of_the_image() -> None:
    (exposed,) = re.findall(r"^EXPOSE (\d+)", DOCKERFILE, re.MULTILINE)
    (port,) = CONTAINER["ports"]
    (allowed,) = MANIFESTS["network.yaml"]["spec"]["ingress"][0]["ports"]
    scraped = POD["metadata"]["annotations"]["prometheus.io/port"]
    assert [port["containerPort"], allowed["port"], int(scraped)] == [int(exposed)] * 3 == [_default("port")] * 3
    named = [CONTAINER[f"{kind}Probe"]["httpGet"]["port"] for kind in ("startup", "liveness", "readiness")]
    assert {*named, MANIFESTS["service.yaml"]["spec"]["ports"][0]["targetPort"]} == {port["name"]}


def test_user_is_that_of_the_image_without_privileges() -> None:
    (user,) = re.findall(r"^USER (\d+)", DOCKERFILE, re.MULTILINE)
    pod, container = POD["spec"]["securityContext"], CONTAINER["securityContext"]
    assert (pod["runAsUser"], pod["runAsNonRoot"]) == (int(user), True)
    assert pod["seccompProfile"]["type"] == "RuntimeDefault"
    assert (container["allowPrivilegeEscalation"], container["readOnlyRootFilesystem"]) == (False, True)
    assert container["capabilities"]["drop"] == ["ALL"]
    assert POD["spec"]["automountServiceAccountToken"] is False


def test_grace_period_exceeds_drain_and_shutdown() -> None:
    assert POD["spec"]["terminationGracePeriodSeconds"] > _default("drain_s") + _default("shutdown_s")


def test_connections_of_all_replicas_fit_into_postgresql() -> None:
    """Count the replicas of the worst time: all new ones run, with the surge of an update, and all old ones drain."""
    most = MANIFESTS["autoscaler.yaml"]["spec"]["maxReplicas"]
    surge = MANIFESTS["deployment.yaml"]["spec"]["strategy"]["rollingUpdate"]["maxSurge"]
    env = {variable["name"]: variable.get("value") for variable in CONTAINER["env"]}
    replicas, connections = most + surge + most, int(env["HOF_DATABASE_CONNECTIONS"])
    assert "HOF_WORKERS" not in env
    assert _default("workers") == 1
    assert replicas * connections <= POSTGRES_CONNECTIONS
    operations = (ROOT / "docs" / "operations.md").read_text("utf-8")
    for text in (
        f"{most} + {surge} + {most} = {replicas} replicas",
        f"`HOF_DATABASE_CONNECTIONS={connections}`",
        f"{replicas} \u00d7 {connections} = {replicas * connections} \u2264 {POSTGRES_CONNECTIONS}",
    ):
        assert text in operations
    assert (
        f"{connections} connections to PostgreSQL (`HOF_DATABASE_CONNECTIONS`), {replicas * connections} in" in README
    )


def test_memory_limits_exceed_what_the_service_admits() -> None:
    """Sum in MiB: idle (benchmarks/RESULTS.md), matting, bodies, answers, and the decoding of a photo a thread."""
    idle = re.search(r"Resident memory: (\d+) MiB idle", (ROOT / "benchmarks" / "RESULTS.md").read_text("utf-8"))
    assert idle
    limits, requests = CONTAINER["resources"]["limits"], CONTAINER["resources"]["requests"]
    photos = int(limits["cpu"]) * WORKING_BYTES * _default("max_image_pixels") / MIB
    held = (_default("max_upload_bytes") + _default("max_answer_bytes")) / MIB
    assert _mib(limits["memory"]) > int(idle[1]) + 275 + held + photos
    assert _mib(requests["memory"]) > int(idle[1]) + 275


def test_selectors_match_the_pods() -> None:
    assert POD["metadata"]["labels"] == LABELS
    assert MANIFESTS["service.yaml"]["spec"]["selector"] == LABELS
    assert MANIFESTS["network.yaml"]["spec"]["podSelector"]["matchLabels"] == LABELS
    for name in ("deployment.yaml", "disruption.yaml"):
        assert MANIFESTS[name]["spec"]["selector"]["matchLabels"] == LABELS
    target = MANIFESTS["autoscaler.yaml"]["spec"]["scaleTargetRef"]
    assert (target["kind"], target["name"]) == ("Deployment", MANIFESTS["deployment.yaml"]["metadata"]["name"])


def test_ingress_has_the_paths_of_clients_alone() -> None:
    (rule,) = MANIFESTS["ingress.yaml"]["spec"]["rules"]
    paths = {path["path"] for path in rule["http"]["paths"]}
    called = json.loads((ROOT / "openapi.json").read_text("utf-8"))["paths"]
    inner = {"/metrics", "/health/live", "/health/ready"}
    api = {"/" + path.split("/")[1] for path in set(called) - inner}
    assert paths == api | {"/", "/viewer", "/docs", "/openapi.json"}
    prefixes = {path["path"] for path in rule["http"]["paths"] if path["pathType"] == "Prefix"}
    assert prefixes == {"/objects", "/v2", "/viewer"}  # of which alone there are paths below
    services = {path["backend"]["service"]["name"] for path in rule["http"]["paths"]}
    assert services == {MANIFESTS["service.yaml"]["metadata"]["name"]}


def test_library_that_the_image_lacks_is_not_loaded(model_path: Path) -> None:
    Encoder.open(model_path, threads=1)
    libraries = Path("/proc/self/maps").read_text()
    assert "onnxruntime_pybind11_state" in libraries
    assert not re.search(r"libonnxruntime\.so\.\d", libraries)
    assert re.search(r"rm \S+/libonnxruntime\.so\.\*$", DOCKERFILE, re.MULTILINE)


def test_image_is_smaller_than_400_mb() -> None:
    parts = image_mb()
    assert parts["onnxruntime"] > 10  # the packages are weighed
    assert re.search(rf"rm \S+/{LEFT_OUT} ", DOCKERFILE)
    assert sum(parts.values()) < 400
