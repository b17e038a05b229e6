# One file, two targets: `service` (no numba in it) and `worker` (no database in it). What each installs is listed beside its sources.
# BASE is any Debian-like image with Python 3.11, 3.12 or 3.13 and its venv module; see docs/containers.md for making one yourself.
# Built by BuildKit: stages run side by side, and caches for pip and compiled kernels outlive a build.
ARG BASE=python:3.12-slim-bookworm
# Kernels for NVIDIA cards in the worker's image, of `python -m renderer.precompile --help`: those of most scenes. "all": of all
# scenes; "": none. What is missing is built by the first worker with a card that needs it, once for a farm.
ARG CARDS=plain,full

FROM ${BASE} AS base
ENV PYTHONUNBUFFERED=1 PATH=/venv/bin:$PATH PYTHONPATH=/app
RUN useradd --create-home --uid 1000 rayfarm \
 && install -d -o rayfarm -g rayfarm -m 700 /data /cache /secrets
WORKDIR /app

# The packages before the sources: editing a source file then rebuilds only the last layers.
FROM base AS packages
RUN apt-get update -q && apt-get install -yq --no-install-recommends binutils && python3 -m venv /venv
COPY constraints.txt ./

FROM packages AS service-packages
COPY service/requirements.txt ./
RUN --mount=type=cache,target=/root/.cache/pip pip install --constraint constraints.txt --requirement requirements.txt
COPY deploy/images/slim.py ./
RUN python3 slim.py /venv

FROM packages AS worker-packages
COPY worker/requirements.txt ./
RUN --mount=type=cache,target=/root/.cache/pip pip install --constraint constraints.txt --requirement requirements.txt
COPY deploy/images/slim.py ./
RUN python3 slim.py /venv

FROM base AS service
COPY --from=service-packages /venv /venv
COPY LICENSE ./
COPY renderer renderer
COPY protocol protocol
COPY telemetry telemetry
COPY worker worker
COPY service service
COPY rayfarm rayfarm
COPY scenes service/examples
COPY blender service/blender
COPY web service/web
COPY docs service/guide_pages
# Into this folder no container may write: what is not compiled here, each start compiles again.
RUN python3 -m compileall -q renderer protocol telemetry worker service rayfarm
COPY deploy/images/rayfarm /usr/local/bin/
USER rayfarm
ENV RAYFARM_DATA=/data RAYFARM_PRINT_LINK=true
VOLUME /data
EXPOSE 8000
HEALTHCHECK --interval=2s --timeout=3s --start-period=30s --retries=15 \
  CMD ["python3", "-IS", "service/healthy.py"]
CMD ["python3", "-m", "service", "--host", "0.0.0.0", "--port", "8000"]

# What the sources mean is kept beside them (by root, as no container can), which each start would find out.
FROM base AS kernels
COPY --from=worker-packages /venv /venv
COPY renderer renderer
RUN python3 -m compileall -q renderer && python3 -c "from renderer import jit; jit.kind()"

# The kernels are compiled here, so that no container compiles them: for processors with AVX-512, if this one has it, and without it,
# side by side. The caches are found again by what the kernels are compiled from, so most edits compile nothing.
FROM kernels AS kernels-avx512
ARG CARDS
RUN --mount=type=cache,id=rayfarm-kernels-avx512,target=/cache,mode=0700 \
    RAYFARM_CACHE=/cache python3 -m renderer.precompile --if-avx512 --cards "$CARDS" /compiled && chmod -R a+rX /compiled

FROM kernels AS kernels-avx2
ARG CARDS
RUN --mount=type=cache,id=rayfarm-kernels-avx2,target=/cache,mode=0700 \
    RAYFARM_AVX512=false RAYFARM_CACHE=/cache python3 -m renderer.precompile --cards "$CARDS" /compiled && chmod -R a+rX /compiled

FROM base AS worker
COPY --from=worker-packages /venv /venv
COPY --from=kernels /app/renderer renderer
COPY --from=kernels-avx2 /compiled/kernels kernels
COPY --from=kernels-avx512 /compiled/kernels kernels
COPY LICENSE ./
COPY protocol protocol
COPY telemetry telemetry
COPY worker worker
RUN python3 -m compileall -q protocol telemetry worker
USER rayfarm
# What a worker fetches and compiles. /tmp holds scenes while they are unpacked, which may be larger than memory.
ENV RAYFARM_CACHE=/cache RAYFARM_KERNELS=/app/kernels RAYFARM_ALIVE=/tmp/worker.alive
VOLUME ["/cache", "/tmp"]
HEALTHCHECK --interval=10s --timeout=3s --start-period=60s --retries=3 \
  CMD ["python3", "-IS", "worker/healthy.py"]
CMD ["python3", "-m", "worker", "--service", "http://service:8000"]
