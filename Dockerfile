# One image for router, world and robots: docker build -t encircle .
# What each container is, and all that it needs to know, is said by arguments or by environment
# variables (docs/hosts.md).

FROM python:3.11-slim AS build
WORKDIR /build
RUN python -m venv /opt/encircle
# Only modules that a run imports are compiled beforehand, below: that halves what there is to store.
ENV PATH=/opt/encircle/bin:$PATH PYTHONDONTWRITEBYTECODE=1
# The packages of the program, at the versions that are tested, without those of its tests. They
# change less often than the program and are a layer of their own.
COPY pyproject.toml requirements.txt ./
RUN python -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['dependencies'], sep='\n')" > wanted.txt \
 && pip install --no-cache-dir --no-compile --constraint requirements.txt --requirement wanted.txt setuptools \
 && find /opt/encircle -type d -name tests -prune -exec rm -rf {} +
COPY README.md LICENSE ./
# encircle/ holds links to the three beside it.
COPY protocol protocol
COPY agents agents
COPY world world
COPY encircle encircle
RUN pip install --no-cache-dir --no-compile --no-build-isolation --no-deps . \
 && pip uninstall --yes setuptools pip \
 && env --unset=PYTHONDONTWRITEBYTECODE --chdir=/ python -c \
    "import encircle.agents.process.robot, encircle.world.process.server, encircle.cli.main, \
     encircle.protocol.programs.alive, encircle.protocol.programs.router, encircle.replay.replaying"

FROM python:3.11-slim
COPY --from=build /opt/encircle /opt/encircle
# Any user may run it; there is no home to write to, and a robot's matrices need no thread pool.
ENV PATH=/opt/encircle/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    HOME=/tmp \
    OPENBLAS_NUM_THREADS=1 \
    OMP_NUM_THREADS=1
RUN mkdir -m 1777 /work
WORKDIR /work
USER 1000:1000
ENTRYPOINT ["encircle"]
CMD ["--help"]
