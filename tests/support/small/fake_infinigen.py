"""A program that answers as `model.data.infinigen.worker` does, without Blender, and misbehaves on demand.

Arguments: a JSON file, object's number -> behavior and "start" -> behavior at the start, "all" -> behavior at all
other objects; and a file that gets the process id of each start.
"""

import json
import os
import resource
import signal
import sys
import time
from pathlib import Path


def main(plan: Path, starts: Path) -> None:
    """Answer requests as `model.data.infinigen.worker` does."""
    behaviors = json.loads(plan.read_text())
    with starts.open("a") as file:
        file.write(f"{os.getpid()}\n")
    if behaviors.get("start") == "fail":
        sys.exit("no module named bpy")
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        answer = _behave(behaviors.get(str(request["seed"]), behaviors.get("all")), request["limit_s"])
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
    if behavior == "slow":
        time.sleep(0.2)
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
