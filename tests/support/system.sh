#!/usr/bin/env bash
# What the tests need beyond Python: Node for the Khronos glTF validator and for npm's packages, Chromium's headless shell
# and Firefox for the page, Chromium itself for the page's benchmark, a C compiler for the kernel, a screen that nobody
# sees for Firefox's WebGL, OpenGL without a screen for the renderer and for MeshLab, curl for the README's lines,
# PostgreSQL and PgBouncer for the store, nginx as a proxy. Installs Debian's packages where the user is root; else names
# the command that does.
set -euo pipefail

missing=()
for tool in node npm gcc curl chromium chromium-headless-shell firefox-esr xvfb-run xauth; do
    command -v "$tool" >/dev/null || missing+=("$(sed 's/^node$/nodejs/; s/^xvfb-run$/xvfb/; s/^gcc$/gcc libc6-dev/' <<<"$tool")")
done
python=$(command -v .venv/bin/python || echo python3)
[ -f "$("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h" ] || missing+=(python3-dev)
compgen -G '/usr/lib/postgresql/*/bin/initdb' >/dev/null || command -v initdb >/dev/null || missing+=(postgresql)
for tool in pgbouncer nginx; do
    PATH="$PATH:/usr/sbin" command -v "$tool" >/dev/null || missing+=("$tool")
done
if [ "$(uname)" = Linux ]; then
    libraries=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p)
    while read -r library package; do
        case $libraries in *"$library"*) ;; *) missing+=("$package") ;; esac
    done <<'PAIRS'
libEGL.so.1 libegl1
libGL.so.1 libgl1
libXrender.so.1 libxrender1
libOpenGL.so.0 libopengl0
PAIRS
    compgen -G '/usr/lib*/dri/*_dri.so' >/dev/null || compgen -G '/usr/lib/*/dri/*_dri.so' >/dev/null ||
        missing+=(libgl1-mesa-dri)
fi
[ ${#missing[@]} -eq 0 ] && exit 0

install="apt-get install -y --no-install-recommends ${missing[*]}"
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "the tests need programs that are missing here; as root run: $install" >&2
    command -v apt-get >/dev/null || echo "(the names are Debian's; install what holds the same on this system)" >&2
    exit 1
fi
export DEBIAN_FRONTEND=noninteractive
apt-get update -qq
$install -qq
