"""Writes the licence texts of all Rust packages that are compiled into the Python package and its program, on this system.

Usage: python tools/make_notices.py [FILE]      (default python/LICENSE-THIRD-PARTY.txt, which wheels and sdists take along)

It asks cargo for the packages, without those of tests and of build scripts, and reads the texts in their sources. A package
without a text is named with the licence that its Cargo.toml states.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "python" / "LICENSE-THIRD-PARTY.txt"
TEXTS = ("LICENSE*", "LICENCE*", "COPYING*", "NOTICE*", "UNLICENSE*", "license*", "licenses/*")


def host_target() -> str:
    """Rust's name of this system, which is the target of the build."""
    output = subprocess.run(["rustc", "-vV"], check=True, capture_output=True, text=True).stdout
    return next(line.removeprefix("host: ") for line in output.splitlines() if line.startswith("host: "))


def packages() -> list[dict]:
    """The packages of others that the Python package is linked with, in the order of their names."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", host_target()]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout)
    known = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    open_ = [one["id"] for one in metadata["packages"] if one["name"] == "gaitfit-python"]
    seen: set[str] = set()
    while open_:
        one = open_.pop()
        if one in seen:
            continue
        seen.add(one)
        for dependency in nodes[one]["deps"]:
            if any(kind["kind"] is None for kind in dependency["dep_kinds"]):
                open_.append(dependency["pkg"])
    others = [known[one] for one in seen if known[one]["source"] is not None]
    return sorted(others, key=lambda package: (package["name"], package["version"]))


def texts(package: dict) -> list[str]:
    """The licence texts of a package, each once."""
    folder = Path(package["manifest_path"]).parent
    files = sorted({file for pattern in TEXTS for file in folder.glob(pattern) if file.is_file()})
    found = [file.read_text(encoding="utf-8", errors="replace").strip() for file in files if file.stat().st_size < 1 << 18]
    return list(dict.fromkeys(found))


def main() -> None:
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else OUT
    groups: dict[str, list[str]] = {}
    for package in packages():
        name = f"{package['name']} {package['version']} ({package['license'] or 'licence in its file'})"
        for text in texts(package) or [""]:
            groups.setdefault(text, []).append(name)
    parts = ["The program gaitfit and its Python package contain code of these packages. Their licence texts follow."]
    for text, names in sorted(groups.items(), key=lambda group: group[1][0]):
        parts.append("\n".join(names) + f"\n\n{text or 'The package has no licence text; the licence is stated above.'}")
    out.write_text(f"\n\n{'-' * 80}\n\n".join(parts) + "\n", encoding="utf-8")
    names = {name for several in groups.values() for name in several}
    print(f"{out}: {len(names)} packages, {len(groups)} texts, {out.stat().st_size // 1024} KiB")


if __name__ == "__main__":
    main()
