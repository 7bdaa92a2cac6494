"""A live picture in the browser, for ``render_mode="human"``."""

from __future__ import annotations

import struct
import threading
import time
import webbrowser
import zlib
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PAGE = """<!doctype html>
<meta charset="utf-8"><title>gaitfit</title>
<style>body { margin: 0; background: #dbe8f5; display: grid; place-items: center; height: 100vh } img { height: 96vh; max-width: 100vw; object-fit: contain }</style>
<img id="picture" alt="The robot">
<script>
// The server answers as soon as there is a picture that the page has not seen.
async function next(seen) {
  try {
    const answer = await fetch(`picture?seen=${seen}`);
    if (answer.status === 200) {
      const image = document.getElementById("picture"), old = image.src;
      image.src = URL.createObjectURL(await answer.blob());
      URL.revokeObjectURL(old);
      seen = answer.headers.get("X-Number");
    }
    next(seen);
  } catch (gone) { document.title = "gaitfit: the environment is closed"; }
}
next(0);
</script>
"""
#: How long a page waits for a picture before it asks again, s.
_WAIT = 5.0


class Window:
    """A page on this machine that shows the picture given last. The browser is opened at the first one; where there is none
    the address is printed.

    Arguments:
        period: Time from picture to picture, s: :meth:`show` waits until it is over.
    """

    def __init__(self, period: float) -> None:
        self._period, self._last = period, -period
        self._number, self._png = 0, b""
        self._changed = threading.Condition()
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        """The page's address; only this machine reaches it."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/"

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Shows a picture, red, green and blue, shape ``(height, width, 3)``, when the last one's time is over."""
        image = png(picture)
        time.sleep(max(0.0, self._last + self._period - time.monotonic()))
        self._last = time.monotonic()
        with self._changed:
            self._number, self._png = self._number + 1, image
            self._changed.notify_all()
        if self._number == 1 and not webbrowser.open(self.address):
            print(f"no browser could be opened; the robot is at {self.address}")

    def close(self) -> None:
        """Ends the page."""
        self._server.shutdown()
        self._server.server_close()

    def _newer(self, seen: int) -> tuple[int, bytes]:
        """The picture after number ``seen``, if there is one within a while."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > seen, _WAIT)
            return (self._number, self._png) if self._number > seen else (seen, b"")

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        newer = self._newer

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:  # noqa: N802
                """A page, or its next picture."""
                path, _, query = self.path.partition("?seen=")
                if path == "/":
                    self._answer(200, "text/html", _PAGE.encode(), 0)
                elif path == "/picture" and query.isdecimal() and len(query) < 10:
                    number, image = newer(int(query))
                    self._answer(200 if image else 204, "image/png", image, number)
                else:
                    self._answer(404, "text/plain", b"", 0)

            def _answer(self, status: int, kind: str, body: bytes, number: int) -> None:
                try:
                    self.send_response(status)
                    self.send_header("Content-Type", kind)
                    self.send_header("Content-Length", str(len(body)))
                    self.send_header("X-Number", str(number))
                    self.end_headers()
                    self.wfile.write(body)
                except ConnectionError:
                    # The page was closed.
                    self.close_connection = True

            def log_message(self, format: str, *_: Any) -> None:
                """Requests are not printed."""

        return Handler


def png(picture: NDArray[np.uint8]) -> bytes:
    """A picture, shape ``(height, width, 3)``, as a PNG file (ISO/IEC 15948): one line of pixels after a 0, deflated."""
    height, width, _ = picture.shape
    lines = np.concatenate([np.zeros((height, 1), np.uint8), picture.reshape(height, 3 * width)], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(lines.tobytes(), 1)) + chunk(b"IEND", b"")
