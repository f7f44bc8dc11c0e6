"""The packages to which identification is compared: their environments, and their runners' processes."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress


@dataclass(frozen=True)
class Peer:
    """A package to measure: its name, its pinned version, and the module that runs it; no version: this project."""

    name: str
    version: str
    module: str

    @property
    def ours(self) -> bool:
        """Whether it is this project."""
        return not self.version

    @property
    def title(self) -> str:
        """Its name and version."""
        return f"{self.name} {version(self.name) if self.ours else self.version}"

    def python(self, folder: Path) -> Path:
        """Its interpreter, in its environment under `folder`."""
        if self.ours:
            return Path(sys.executable)
        return folder.absolute() / self.name / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


OURS = Peer("auv-gym", "", "scripts.benchmarks.peers.run_ours")
PEERS = (
    Peer("sippy_unipi", "1.0.1", "scripts.benchmarks.peers.run_sippy"),
    Peer("llsi", "0.5.0", "scripts.benchmarks.peers.run_llsi"),
    Peer("nfoursid", "1.0.2", "scripts.benchmarks.peers.run_nfoursid"),
    Peer("sysidentpy", "0.9.0", "scripts.benchmarks.peers.run_sysidentpy"),
    Peer("control", "0.10.2", "scripts.benchmarks.peers.run_control"),
)
KERNEL_OURS = Peer("auv-gym", "", "scripts.benchmarks.peers.run_kernel")
KERNEL_PEERS = (Peer("scikit-learn", "1.9.1", "scripts.benchmarks.peers.run_sklearn"),)


def add_peer_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of a benchmark beside other packages."""
    parser.add_argument("--peers", type=Path, default=Path(".peers"), help="environments of others (default: .peers)")
    parser.add_argument("--make-peers", action="store_true", help="make the environments that are not there, with pip")
    parser.add_argument("--threads", type=int, default=1, help="of linear algebra, in all processes (default: 1)")


def wide_console() -> Console:
    """A console for tables of 120 columns, if no terminal states its width."""
    console = Console()
    return console if console.is_terminal else Console(width=max(console.width, 120))


def make(folder: Path, peers: Sequence[Peer] = PEERS) -> None:
    """Create an environment for every peer, with its pinned version, by pip; raises if one cannot be made."""
    with Progress(transient=True, console=Console(stderr=True)) as progress:
        for peer in progress.track(peers, description="environments"):
            if not peer.python(folder).exists():
                venv.create(folder / peer.name, with_pip=True)
            pin = f"{peer.name}=={peer.version}"
            command = [str(peer.python(folder)), "-m", "pip", "install", "--quiet", "--no-input", pin]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise ValueError(f"pip could not install {pin} in {folder / peer.name}: {_last(done.stderr)}")


def run(peer: Peer, folder: Path, environments: Path, threads: int) -> Iterator[dict[str, Any]]:
    """The lines of a runner as they come; raises if its process fails."""
    counts = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), str(threads))
    with tempfile.TemporaryFile("w+", encoding="utf-8") as log:
        process = subprocess.Popen(
            [str(peer.python(environments)), "-W", "ignore", "-m", peer.module, str(folder)],
            env={**os.environ, **counts, "PYTHONPATH": str(Path(__file__).parents[3]), "MPLBACKEND": "agg"},
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        )
        with process:
            try:
                for line in process.stdout or ():
                    yield json.loads(line)
            except BaseException:
                process.kill()
                raise
        if process.returncode:
            log.seek(0)
            raise ValueError(f"its runner ended with code {process.returncode}: {_last(log.read())}")


def _last(text: str) -> str:
    return (text.strip().splitlines() or ["no message"])[-1]
