"""Makes the pictures of README.md from a finished run of examples/go2-ground.

    gaitfit loop examples/go2-ground/loop.toml
    python tools/make_pictures.py runs/go2-ground

Needs Chromium, and Pillow (which matplotlib in tools/requirements.txt brings along).

- docs/pictures/before-after.webp: both policies under the same commands, from the replay of the report
- docs/pictures/report.webp: the top of the report
"""

import argparse
import pathlib
import shutil
import subprocess
import sys
import tempfile

from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parent.parent
NAMES = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"]
# Leaves nothing on the page but the two robots.
ALONE = "header,nav,main>section:not(#motion),#motion>h2,#motion>.lead,.controls,footer{display:none!important}"
ALONE += "body,main,section,#motion,#player{margin:0!important;padding:0!important;max-width:none!important;border:0}"
ALONE += "#player{height:100vh!important}#stage{height:100vh!important}"


def shoot(browser: str, page: str, out: pathlib.Path, size: tuple[int, int]) -> Image.Image:
    """A picture of a page, `size` in pixels."""
    command = [browser, "--headless=new", "--no-sandbox", "--hide-scrollbars", "--enable-unsafe-swiftshader"]
    command += [f"--window-size={size[0]},{size[1]}", "--virtual-time-budget=4000", f"--screenshot={out}", page]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=180)
    return Image.open(out).convert("RGB")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=pathlib.Path, help="run folder of the loop")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "docs" / "pictures")
    parser.add_argument("--from", type=float, default=1.0, dest="begin", help="first second of the replay [1]")
    parser.add_argument("--seconds", type=float, default=4.0, help="length of the animation [4]")
    parser.add_argument("--rate", type=int, default=10, help="pictures a second [10]")
    args = parser.parse_args()
    report = args.run / "report.html"
    browser = next((found for name in NAMES if (found := shutil.which(name))), None)
    if browser is None:
        print(f"make_pictures.py: none of {', '.join(NAMES)} is on the path; install Chromium", file=sys.stderr)
        return 4
    if not report.is_file():
        print(f"make_pictures.py: {report} is missing; run `gaitfit loop examples/go2-ground/loop.toml` first", file=sys.stderr)
        return 1
    args.out.mkdir(parents=True, exist_ok=True)
    html = report.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        page, picture = folder / "page.html", folder / "page.png"
        page.write_text(html.replace("</head>", f"<style>{ALONE}</style></head>", 1), encoding="utf-8")
        frames = []
        for frame in range(round(args.seconds * args.rate)):
            time = args.begin + frame / args.rate
            frames.append(shoot(browser, f"{page.as_uri()}#t={time:.2f}", picture, (880, 330)))
        top = shoot(browser, report.resolve().as_uri(), picture, (1100, 900))
    animation = args.out / "before-after.webp"
    frames[0].save(animation, save_all=True, append_images=frames[1:], duration=1000 // args.rate, loop=0, quality=55, method=6)
    still = args.out / "report.webp"
    top.save(still, quality=80, method=6)
    for file in [animation, still]:
        print(f"{file}: {file.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
