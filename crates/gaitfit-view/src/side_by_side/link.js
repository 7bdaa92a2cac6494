// Joins the curves with the player's clock: a line at its time in every panel, and a click on a curve sets it.
(function () {
  "use strict";
  const numbers = (text) => text.split(" ").map(Number);
  const panels = Array.from(document.querySelectorAll("#curves .panel[data-x]"), (panel) => {
    const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
    const box = numbers(panel.dataset.box);
    line.setAttribute("class", "now");
    line.setAttribute("y1", box[1]);
    line.setAttribute("y2", box[3]);
    panel.appendChild(line);
    return { panel, line, box, range: numbers(panel.dataset.x) };
  });
  const show = (time) => {
    panels.forEach(({ line, box, range }) => {
      const share = (time - range[0]) / (range[1] - range[0]);
      const x = box[0] + Math.max(0, Math.min(1, share)) * (box[2] - box[0]);
      line.setAttribute("x1", x);
      line.setAttribute("x2", x);
    });
  };
  document.addEventListener("gaitfit-time", (event) => show(event.detail));
  // The player may have drawn before the curves were there.
  const slider = document.getElementById("time");
  show(slider === null ? 0 : Number(slider.value));
  document.querySelectorAll("#curves svg[role=img]").forEach((svg) => {
    const own = panels.filter(({ panel }) => svg.contains(panel));
    const seek = (event) => {
      if (own.length === 0) { return; }
      const { box, range } = own[0];
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const share = Math.max(0, Math.min(1, (at.x - box[0]) / (box[2] - box[0])));
      document.dispatchEvent(new CustomEvent("gaitfit-seek", { detail: range[0] + share * (range[1] - range[0]) }));
    };
    svg.addEventListener("pointerdown", seek);
    svg.addEventListener("pointermove", (event) => { if (event.buttons === 1) { seek(event); } });
  });
})();
