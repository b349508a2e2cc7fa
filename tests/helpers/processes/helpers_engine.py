"""A container engine of the tests' own, on a machine that has none and reaches no image registry.

It is Debian's, with its data in a temporary directory, and needs root. One daemon without networks
of its own builds images in the machine's network, from which packages can be fetched; another, in a
network namespace, runs them, so that no rule or address of the machine is touched. The base image
is made by debootstrap under the name that the Dockerfile begins from. Where packages come from is
what the machine itself says to apt and to pip, asked at run time.
"""

import contextlib
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from helpers_waiting import completed, ended, until

PACKAGES = {
    "dockerd": "docker.io",
    "docker-compose": "docker-compose",
    "runc": "runc",
    "containerd": "containerd",
    "iptables": "iptables",
    "debootstrap": "debootstrap",
    "ip": "iproute2",
}
COMPOSE_V2_RELEASE = "trixie"
"""The first release of Debian with Compose v2; it also runs on the one before."""
BASE_IMAGE = "python:3.11-slim"
BASE_PACKAGES = "python3,python3-pip,python3-venv,ca-certificates"
CERTIFICATES = Path("etc/ssl/certs/ca-certificates.crt")
PIP_SETTINGS = ("index-url", "extra-index-url", "trusted-host", "proxy", "timeout", "retries")
POLICY = Path("/usr/sbin/policy-rc.d")
ADDRESS = "172.31.255.1"
"""Of the machine, as containers see it."""


def output(
    *command: str,
    env: Mapping[str, str] | None = None,
    cwd: Path | None = None,
) -> str:
    """What a command says on standard output; ``AssertionError`` with all it said if it fails."""
    done = completed(command, env=os.environ | (env or {}), cwd=cwd)
    said = f"{' '.join(command[:4])} ... ended with {done.returncode}:\n{done.stdout}{done.stderr}"
    assert done.returncode == 0, said[-8000:]
    return done.stdout


def install() -> None:
    """The engine and what makes the base image, from the machine's own package sources."""
    missing = [package for tool, package in PACKAGES.items() if shutil.which(tool) is None]
    if not missing:
        return
    quiet = {"DEBIAN_FRONTEND": "noninteractive"}
    output("apt-get", "update", "--quiet", env=quiet)
    with _services_stay_off():
        output("apt-get", "install", "--yes", "--no-install-recommends", *missing, env=quiet)


def fetch_compose_v2(root: Path) -> Path:
    """Compose v2, from where this machine's own packages come, unpacked into ``root``."""
    (root / "lists" / "partial").mkdir(parents=True)
    sources = root / "sources.list"
    keys = "/usr/share/keyrings/debian-archive-keyring.gpg"
    mirror = _package_source(platform.freedesktop_os_release()["VERSION_CODENAME"])
    sources.write_text(f"deb [signed-by={keys}] {mirror} {COMPOSE_V2_RELEASE} main\n")
    options = {
        "Dir::Etc::SourceList": str(sources),
        "Dir::Etc::SourceParts": "/dev/null",
        "Dir::State::Lists": str(root / "lists"),
        "Dir::Cache": str(root),
        "APT::Sandbox::User": "root",
    }
    settings = [f"--option={name}={value}" for name, value in options.items()]
    output("apt-get", *settings, "update", "--quiet")
    output("apt-get", *settings, "download", "docker-compose", cwd=root)
    (package,) = root.glob("docker-compose_*.deb")
    output("dpkg-deb", "--extract", str(package), str(root / "system"))
    return root / "system/usr/libexec/docker/cli-plugins/docker-compose"


def _package_source(codename: str) -> str:
    """Where this machine gets the packages of its Debian release."""
    which = ("--format", "$(REPO_URI)", "Created-By: Packages", f"Codename: {codename}")
    return output("apt-get", "indextargets", *which).split()[0]


@contextlib.contextmanager
def _services_stay_off() -> Iterator[None]:
    """Packages of daemons start them when installed, unless this file says no."""
    if POLICY.exists():
        yield
        return
    POLICY.write_text("#!/bin/sh\nexit 101\n")
    POLICY.chmod(0o755)
    try:
        yield
    finally:
        POLICY.unlink()


class Daemon:
    """A ``dockerd`` as long as a context lasts."""

    def __init__(self, root: Path, name: str, within: tuple[str, ...], flags: tuple[str, ...]):
        self._pid_file = root / f"{name}.pid"
        self._log = root / f"{name}.log"
        self.address = f"unix://{root / name}.sock"
        self._command = [
            *within,
            "dockerd",
            *("--host", self.address, "--pidfile", str(self._pid_file)),
            *("--data-root", str(root / "data"), "--exec-root", str(root / f"{name}-exec")),
            *("--oom-score-adjust", "0", "--default-ulimit", "nofile=1024:4096"),
            *flags,
        ]

    @property
    def env(self) -> dict[str, str]:
        return {"DOCKER_HOST": self.address, "DOCKER_BUILDKIT": "0"}

    def __enter__(self) -> "Daemon":
        with open(self._log, "wb") as log:
            self._process = subprocess.Popen(self._command, stdout=log, stderr=log)
        try:
            until(self._answers, "dockerd to start", lambda: self._log.stat().st_size)
        except AssertionError:
            self.__exit__()
            raise AssertionError(
                f"dockerd did not start:\n{self._log.read_text()[-4000:]}"
            ) from None
        return self

    def _answers(self) -> bool:
        assert self._process.poll() is None
        try:
            output("docker", "version", env=self.env)
        except AssertionError:
            return False
        return True

    def docker(self, *arguments: str) -> str:
        return output("docker", *arguments, env=self.env)

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            ended(self._process)
        finally:
            self._process.kill()
            self._process.wait()


def building(root: Path) -> Daemon:
    """A daemon that builds in the machine's network and touches nothing of it."""
    flags = ("--bridge=none", "--iptables=false", "--ip6tables=false", "--ip-forward=false")
    return Daemon(root, "build", (), (*flags, "--ip-masq=false"))


@contextlib.contextmanager
def running(root: Path) -> Iterator[Daemon]:
    """A daemon on the same data with networks, all inside a network namespace."""
    space = f"encircle-engine-{os.getpid()}"
    output("ip", "netns", "add", space)
    try:
        output("ip", "-n", space, "link", "set", "lo", "up")
        within = ("nsenter", f"--net=/run/netns/{space}")
        with Daemon(root, "run", within, (f"--bip={ADDRESS}/24",)) as daemon:
            yield daemon
    finally:
        output("ip", "netns", "delete", space)


def remove(root: Path) -> None:
    """Remove the engine's directory, with what daemons that have ended left mounted there."""
    mounted = [line.split()[1] for line in Path("/proc/mounts").read_text().splitlines()]
    for place in reversed(mounted):
        if place.startswith(f"{root}/"):
            output("umount", place)
    shutil.rmtree(root)


def make_base_image(root: Path, daemon: Daemon) -> None:
    """A Debian with Python, of this machine's release, under the name of the official image."""
    system = root / "system"
    codename = platform.freedesktop_os_release()["VERSION_CODENAME"]
    include = f"--include={BASE_PACKAGES}"
    output(
        "debootstrap",
        "--variant=minbase",
        include,
        codename,
        str(system),
        _package_source(codename),
    )
    system.chmod(0o755)
    (system / "usr/bin/python").symlink_to("python3")
    for marker in system.glob("usr/lib/python3*/EXTERNALLY-MANAGED"):
        marker.unlink()
    shutil.rmtree(system / "var/cache/apt")
    settings = _pip_settings()
    bundle = Path(settings.pop("cert", f"/{CERTIFICATES}"))
    if bundle.exists():
        shutil.copy(bundle, system / CERTIFICATES)
    changes = [f"--change=ENV PIP_{k.replace('-', '_').upper()}={v}" for k, v in settings.items()]
    changes.append(f"--change=ENV PIP_CERT=/{CERTIFICATES}")
    with subprocess.Popen(["tar", "-C", str(system), "-c", "."], stdout=subprocess.PIPE) as tar:
        subprocess.run(
            ["docker", "import", *changes, "-", BASE_IMAGE],
            stdin=tar.stdout,
            stdout=subprocess.DEVNULL,
            env=os.environ | daemon.env,
            check=True,
        )
    shutil.rmtree(system)


def _pip_settings() -> dict[str, str]:
    """How this machine's pip reaches its packages; paths of this machine mean nothing elsewhere."""
    lines = output(sys.executable, "-m", "pip", "config", "list").splitlines()
    pairs = (line.partition("=")[::2] for line in lines)
    found = {name.rpartition(".")[2]: value.strip("'") for name, value in pairs}
    remote = {name: found[name] for name in PIP_SETTINGS if name in found}
    usable = {name: value for name, value in remote.items() if "file:" not in value}
    return usable | ({"cert": found["cert"]} if "cert" in found else {})
