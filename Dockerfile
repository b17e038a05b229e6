# One file, two targets: `service` (no numba in it) and `worker` (no database in it). What each installs is listed beside its sources.
# BASE is any Debian-like image with Python 3.11 or 3.12 and its venv module; see docs/deployment.md for making one yourself.
ARG BASE=python:3.12-slim-bookworm

FROM ${BASE} AS base
ENV PYTHONUNBUFFERED=1 PIP_NO_CACHE_DIR=1 PATH=/venv/bin:$PATH PYTHONPATH=/app
RUN python3 -m venv /venv \
 && useradd --create-home --uid 1000 rayfarm \
 && mkdir -p /data /home/rayfarm/.cache/rayfarm \
 && chown -R rayfarm /data /home/rayfarm/.cache
WORKDIR /app
COPY constraints.txt LICENSE ./

# The packages before the sources: editing a source file then rebuilds only the last layers.
FROM base AS service
COPY service/requirements.txt service/requirements.txt
RUN pip install --constraint constraints.txt --requirement service/requirements.txt
COPY renderer renderer
COPY worker worker
COPY service service
COPY scenes service/scenes
COPY blender service/blender
COPY web service/web
# Into this folder no container may write: what is not compiled here, each start compiles again.
RUN python3 -m compileall -q renderer worker service
USER rayfarm
ENV RAYFARM_DATA=/data RAYFARM_PRINT_LINK=true
VOLUME /data
EXPOSE 8000
HEALTHCHECK --interval=2s --timeout=3s --start-period=30s --retries=15 \
  CMD ["python3", "-IS", "service/healthy.py"]
CMD ["python3", "-m", "service", "--host", "0.0.0.0", "--port", "8000"]

FROM base AS worker
COPY worker/requirements.txt worker/requirements.txt
RUN pip install --constraint constraints.txt --requirement worker/requirements.txt
COPY renderer renderer
USER rayfarm
# The kernels are compiled here, so that no container compiles them, for processors with AVX-512 (if this one has it) and without
# it; what their sources mean is kept too, which each start would find out. The volume holds fetched scenes alone.
RUN for avx512 in true false; do \
      RAYFARM_AVX512=$avx512 python3 -c "from renderer import jit; from renderer.render import EDITIONS, warm_up; \
        print(jit.kind(), [warm_up(edition=name) for name in EDITIONS])" || exit; \
    done && mkdir -p /home/rayfarm/.cache/rayfarm/blobs
USER root
COPY worker worker
RUN python3 -m compileall -q renderer worker
USER rayfarm
VOLUME /home/rayfarm/.cache/rayfarm/blobs
CMD ["python3", "-m", "worker", "--service", "http://service:8000"]
