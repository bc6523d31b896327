"use strict";
// Unpacks plotly.js from this page, then draws the 3-D clouds that are on the screen: a browser allows only few at once.
(function () {
  async function loadPlotly() {
    const packed = document.getElementById("plotly-gz").textContent.trim();
    const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const code = await new Response(stream).text();
    const script = document.createElement("script");
    script.textContent = code;
    document.head.appendChild(script);
    return window.Plotly;
  }
  function wire(plotly) {
    let drawn = 0;
    for (const cloud of document.querySelectorAll(".cloud")) {
      const scenes = JSON.parse(document.getElementById(cloud.dataset.scenes).textContent);
      const buttons = cloud.parentElement.querySelectorAll(".tabs button");
      const still = cloud.querySelector(".still");
      const target = document.createElement("div");
      target.style.height = "100%";
      let chosen = 0;
      let shown = false;
      const draw = async () => {
        const scene = scenes[chosen];
        await plotly.newPlot(target, scene.data, scene.layout, { responsive: true, displaylogo: false,
          modeBarButtonsToRemove: ["sendDataToCloud"] });
        drawn += 1;
        document.documentElement.dataset.drawn = String(drawn);
      };
      buttons.forEach((button, number) => {
        button.addEventListener("click", () => {
          chosen = number;
          buttons.forEach((other, k) => other.setAttribute("aria-pressed", String(k === number)));
          if (shown) { draw(); }
        });
      });
      new IntersectionObserver((entries) => {
        const visible = entries.some((entry) => entry.isIntersecting);
        if (visible && !shown) {
          shown = true;
          still.style.display = "none";
          cloud.appendChild(target);
          draw();
        } else if (!visible && shown) {
          shown = false;
          plotly.purge(target);
          target.remove();
          still.style.display = "";
        }
      }, { rootMargin: "200px" }).observe(cloud);
    }
  }
  loadPlotly().then(wire).catch((error) => {
    // The still pictures stay; nothing else depends on the script.
    document.documentElement.dataset.failed = String(error);
    for (const note of document.querySelectorAll(".cloud-note")) {
      note.textContent = "This browser cannot draw the interactive figure; the still one is shown.";
    }
  });
})();
