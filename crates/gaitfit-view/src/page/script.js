// Read-out under the pointer: turns positions in a panel back into values. The page is complete without it.
(function () {
  "use strict";
  var box = document.createElement("div");
  box.className = "readout";
  box.hidden = true;
  document.body.appendChild(box);
  var cross = document.createElementNS("http://www.w3.org/2000/svg", "line");
  cross.setAttribute("class", "cross");

  function numbers(text) { return text.split(" ").map(Number); }
  function points(path) {
    if (!path.parsed) {
      path.parsed = path.getAttribute("d").split(/[ML]/).slice(1).map(numbers);
    }
    return path.parsed;
  }
  function shown(value) {
    return String(Number(value.toPrecision(3))).replace("-", "\u2212");
  }
  function hide() { box.hidden = true; cross.remove(); }

  function move(event) {
    var svg = event.currentTarget;
    var at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    var panel = Array.from(svg.querySelectorAll(".panel[data-x]")).find(function (p) {
      var b = numbers(p.dataset.box);
      return [at.x - b[0], at.y - b[1], b[2] - at.x, b[3] - at.y].every(function (d) { return Math.sign(d) !== -1; });
    });
    if (!panel) { hide(); return; }
    var b = numbers(panel.dataset.box), x = numbers(panel.dataset.x), y = numbers(panel.dataset.y);
    var log = panel.dataset.log === "1";
    var lines = [];
    panel.querySelectorAll("[data-n]:not(.faint)").forEach(function (path) {
      var best = null, distance = Infinity;
      points(path).forEach(function (p) {
        var d = Math.abs(p[0] - at.x);
        if (Math.min(d, distance) === d) { best = p; distance = d; }
      });
      if (!best) { return; }
      var share = (b[3] - best[1]) / (b[3] - b[1]);
      var value = log ? y[0] * Math.pow(y[1] / y[0], share) : y[0] + share * (y[1] - y[0]);
      lines.push(path.dataset.n + "  " + shown(value));
    });
    if (lines.length === 0) { hide(); return; }
    var along = (at.x - b[0]) / (b[2] - b[0]);
    lines.unshift(shown(panel.dataset.xlog === "1" ? x[0] * Math.pow(x[1] / x[0], along) : x[0] + along * (x[1] - x[0])));
    box.textContent = lines.slice(0, 12).join("\n");
    box.hidden = false;
    var right = Math.max(event.clientX + 14 + box.offsetWidth - document.documentElement.clientWidth, 0);
    box.style.left = (right === 0 ? event.clientX + 14 : event.clientX - 14 - box.offsetWidth) + "px";
    box.style.top = (event.clientY + 14) + "px";
    ["x1", "x2"].forEach(function (k) { cross.setAttribute(k, at.x); });
    cross.setAttribute("y1", b[1]);
    cross.setAttribute("y2", b[3]);
    panel.appendChild(cross);
  }

  // A box that scrolls is reached by the keyboard.
  var boxes = document.querySelectorAll(".scroll, pre.config");
  function reach(box) {
    var wide = Math.sign(box.scrollWidth - box.clientWidth - 1) === 1;
    if (wide) { box.tabIndex = 0; box.setAttribute("role", "group"); box.setAttribute("aria-label", "scrolls sideways"); }
    else { ["tabindex", "role", "aria-label"].forEach(function (name) { box.removeAttribute(name); }); }
  }
  var resized = new ResizeObserver(function (seen) { seen.forEach(function (one) { reach(one.target); }); });
  boxes.forEach(function (box) { resized.observe(box); });

  document.querySelectorAll("svg[role=img]").forEach(function (svg) {
    if (svg.querySelector("[data-n]")) {
      svg.addEventListener("pointermove", move);
      svg.addEventListener("pointerleave", hide);
    }
  });
})();
