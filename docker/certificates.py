"""Certificates of a Dask cluster: an authority of its own, and one pair that everybody in the cluster shows.

usage: certificates.py DIRECTORY [DAYS]

Writes ca.pem, certificate.pem and key.pem into DIRECTORY, which is made if it is not there; what is in it and good for
another month is kept.  Who has the pair may run code on the cluster, and who has not may not even connect.  The key of
the authority is forgotten, so nobody can make a further pair: to replace it, delete the files, run this again and
restart the cluster.
"""

from __future__ import annotations

import datetime
import os
import sys
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

DAYS = 365
LEFT_DAYS = 30  # with fewer, new ones are made
FILES = ("ca.pem", "key.pem", "certificate.pem")


def days_left(directory: Path) -> float:
    """Days for which the pair is still good; 0.0 if a file is missing."""
    if not all((directory / name).exists() for name in FILES):
        return 0.0
    certificate = x509.load_pem_x509_certificate((directory / "certificate.pem").read_bytes())
    return (certificate.not_valid_after_utc - datetime.datetime.now(datetime.UTC)) / datetime.timedelta(days=1)


def make(directory: Path, days: float) -> None:
    """Write the three files, each at once and for its owner only."""
    authority_key, key = ec.generate_private_key(ec.SECP256R1()), ec.generate_private_key(ec.SECP256R1())
    issuer = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "tailstack Dask cluster")])
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "member of the cluster")])
    now = datetime.datetime.now(datetime.UTC)

    def signed(name: x509.Name, public: ec.EllipticCurvePublicKey, *extensions: x509.ExtensionType) -> bytes:
        builder = (
            x509.CertificateBuilder()
            .subject_name(name)
            .issuer_name(issuer)
            .public_key(public)
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - datetime.timedelta(minutes=5))
            .not_valid_after(now + datetime.timedelta(days=days))
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(authority_key.public_key()), critical=False
            )
        )
        for extension in extensions:
            builder = builder.add_extension(extension, critical=True)
        return builder.sign(authority_key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)

    may = dict.fromkeys(
        ("digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement",
         "key_cert_sign", "crl_sign", "encipher_only", "decipher_only"), False,
    )  # fmt: skip
    authority = signed(
        issuer, authority_key.public_key(), x509.BasicConstraints(ca=True, path_length=0),
        x509.KeyUsage(**{**may, "key_cert_sign": True}),
    )  # fmt: skip
    # Dask checks who signed it and not whom it names: the names of containers change
    member = signed(
        subject, key.public_key(), x509.BasicConstraints(ca=False, path_length=None),
        x509.KeyUsage(**{**may, "digital_signature": True}),
        x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]),
    )  # fmt: skip
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    for name, content in zip(FILES, (authority, private, member), strict=True):
        write(directory / name, content)


def write(path: Path, content: bytes) -> None:
    """Replace a file at once, readable by its owner only."""
    partial = path.with_suffix(".new")
    partial.unlink(missing_ok=True)
    with open(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(content)
    partial.replace(path)


def main(arguments: list[str]) -> int:
    if not 1 <= len(arguments) <= 2:
        print(__doc__, file=sys.stderr)
        return 2
    directory, days = Path(arguments[0]), float(arguments[1]) if len(arguments) > 1 else DAYS
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    left = days_left(directory)
    if left > LEFT_DAYS:
        print(f"{directory}: good for another {left:.0f} days")
        return 0
    make(directory, days)
    print(f"{directory}: made, good for {days:g} days")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
