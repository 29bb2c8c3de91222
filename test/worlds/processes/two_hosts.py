"""Two hosts on one machine: network namespaces of the kernel, with a cable between them and none to anywhere else."""

import json
import os
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

ADDRESSES = ("10.77.0.1/24", "10.77.0.2/24")
OVER_THE_CABLE = ["env", "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET", "FASTDDS_BUILTIN_TRANSPORTS=UDPv4"]
"""No further than the namespace reaches; not by shared memory, which both have in common."""


@dataclass(frozen=True)
class Host:
    """One of the two."""

    name: str  # of the namespace
    cable: str  # its end

    def command(self, words: Sequence[str]) -> list[str]:
        """A command as this host runs it."""
        return ["nsenter", f"--net=/run/netns/{self.name}", *OVER_THE_CABLE, *words]

    def sent_bytes(self) -> int:
        """What it has sent over the cable."""
        words = ["ip", "-netns", self.name, "-json", "-statistics", "link", "show", self.cable]
        (link,) = json.loads(subprocess.run(words, check=True, capture_output=True).stdout)
        return int(link["stats64"]["tx"]["bytes"])


@contextmanager
def two_hosts() -> Iterator[tuple[Host, Host]]:
    """Gone afterwards, with what is left in them."""
    number = os.getpid()
    hosts = Host(f"slam{number}a", f"a{number}"), Host(f"slam{number}b", f"b{number}")
    try:
        for host in hosts:
            _ip("netns", "add", host.name)
        one, other = hosts
        _ip("link", "add", one.cable, "netns", one.name, "type", "veth", "peer", other.cable, "netns", other.name)
        for host, address in zip(hosts, ADDRESSES, strict=True):
            _ip("-netns", host.name, "address", "add", address, "dev", host.cable)
            for name in ("lo", host.cable):
                _ip("-netns", host.name, "link", "set", name, "up")
        yield hosts
    finally:
        for host in hosts:
            subprocess.run(["ip", "netns", "delete", host.name], check=False, capture_output=True)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)
