# Images of the program, of which docs/hosts.md says what each carries:
#   docker build -t encircle .                                   nodes: router, world, robot, doctor
#   docker build -t encircle-laboratory --target laboratory .    the same, and the whole laboratory
# What each container is, and all that it needs to know, is said by arguments or by environment
# variables.

FROM python:3.11-slim AS packages
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

# What a node never imports goes: what draws, and what writes tables on a terminal.
FROM packages AS node-build
RUN pip uninstall --yes matplotlib contourpy cycler fonttools kiwisolver packaging pillow pyparsing \
    python-dateutil rich markdown-it-py mdurl Pygments
COPY README.md LICENSE ./
# encircle/ holds links to the three beside it.
COPY protocol protocol
COPY agents agents
COPY world world
COPY encircle encircle
RUN pip install --no-cache-dir --no-compile --no-build-isolation --no-deps . \
 && pip uninstall --yes setuptools pip \
 && env --unset=PYTHONDONTWRITEBYTECODE --chdir=/ python -c \
    "import encircle.cli.main, encircle.protocol.programs.alive; \
     from encircle.runner.fork_server import preload; preload()"

# Studies and certificates need more.
FROM packages AS laboratory-build
RUN python -c "import tomllib; more = tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']; print(*more['studies'], *more['security'], sep='\n')" > more.txt \
 && pip install --no-cache-dir --no-compile --constraint requirements.txt --requirement more.txt \
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
    "import encircle.cli.main, encircle.cli.hunting, encircle.figures.run_figures, \
     encircle.studies.command, encircle.replay.replaying, encircle.protocol.programs.alive; \
     from encircle.runner.fork_server import preload; preload()"

FROM python:3.11-slim AS base
# Any user may run it; there is no home to write to, a robot's matrices need no thread pool, and
# files in the working directory are not modules of ours.
ENV PATH=/opt/encircle/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONSAFEPATH=1 \
    ENCIRCLE_POLICIES=/files \
    HOME=/tmp \
    OPENBLAS_NUM_THREADS=1 \
    OMP_NUM_THREADS=1
RUN mkdir -m 1777 /work
WORKDIR /work
USER 1000:1000
ENTRYPOINT ["encircle"]
CMD ["--help"]

FROM base AS laboratory
COPY --from=laboratory-build /opt/encircle /opt/encircle

FROM base AS node
COPY --from=node-build /opt/encircle /opt/encircle
