"""A worker as `model.data.infinigen.worker`, without Blender: a program that does as it is told, by object.

Arguments: a JSON file, object's number -> behavior, "start" -> behavior at the start; and a file that gets a line per
start.
"""

import json
import os
import resource
import signal
import sys
import time
from pathlib import Path


def main(behaviors: Path, starts: Path) -> None:
    """Answer requests as `model.data.infinigen.worker` does."""
    told = json.loads(behaviors.read_text())
    with starts.open("a") as file:
        file.write(f"{os.getpid()}\n")
    if told.get("start") == "fail":
        sys.exit("no module named bpy")
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        answer = _behave(told.get(str(request["seed"])), request["limit_s"])
        if not answer:
            Path(request["file"]).write_bytes(b"glTF")
            answer = json.dumps({"triangles": 12})
        print(answer, flush=True)


def _behave(behavior: str | None, limit_s: int) -> str | None:
    """Hang, crash, or return an answer other than that of a finished object."""
    if behavior == "loop":
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, resource.RLIM_INFINITY))
        while True:
            pass
    if behavior == "sleep":
        time.sleep(600)
    if behavior == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    return {
        "error": json.dumps({"error": "RuntimeError: the factory made no mesh"}),
        "garbage": "Fra:1 Mem:22.49M",
        "flood": "x" * 50_000,
        "list": "[]",
        "nothing": json.dumps({"triangles": 12}),
    }.get(behavior or "")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
