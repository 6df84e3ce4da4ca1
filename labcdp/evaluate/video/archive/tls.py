"""Certificates by which a computer and a cluster know each other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....core.errors import InputError


@dataclass(frozen=True)
class TlsFiles:
    """Files by which the two sides of a connection know each other and encrypt what they send (PEM).

    Parameters
    ----------
    ca : Path
        Certificate of the authority that signed those of scheduler and workers.
    certificate, key : Path
        Of this computer.

    Raises
    ------
    InputError
        If there is no such file.
    """

    ca: Path
    certificate: Path
    key: Path

    def __post_init__(self) -> None:
        for name in ("ca", "certificate", "key"):
            path = getattr(self, name)
            if not path.is_file():
                raise InputError(f"{path} is no file: give the {name} of the cluster as a PEM file")

    def security(self) -> Any:
        """Return them as Dask takes them; what is sent is encrypted."""
        from distributed.security import Security

        return Security(
            require_encryption=True,
            tls_ca_file=str(self.ca),
            tls_client_cert=str(self.certificate),
            tls_client_key=str(self.key),
        )
