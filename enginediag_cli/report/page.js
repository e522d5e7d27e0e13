"use strict";
(function () {
  var colours = COLOURS, dark = matchMedia("(prefers-color-scheme: dark)"), drawn = new Map();
  function draw(figure) {
    var live = figure.querySelector(".live"), still = figure.querySelector(".drawn");
    var text = figure.querySelector("script.plot").textContent;
    if (dark.matches) colours.forEach(function (pair) { text = text.split(pair[0]).join(pair[1]); });
    live.hidden = false;
    var plot = JSON.parse(text), place = document.createElement("div");
    plot.item.target_id = place.id = figure.id + "-live";
    live.replaceChildren(place);
    return Bokeh.embed.embed_item(plot.item).then(function () {
      var shown = Bokeh.documents[Bokeh.documents.length - 1].roots()[0];
      live.prepend(legend(plot.legend, shown));
      drawn.set(figure, true);
      still.classList.add("instead");
      figure.dataset.drawn = "yes";
    }).catch(function (error) { live.hidden = true; console.error(String(error)); });
  }
  function legend(series, shown) {
    var box = document.createElement("div");
    box.className = "legend";
    series.forEach(function (pair) {
      var button = document.createElement("button"), swatch = document.createElement("span");
      button.type = "button";
      button.title = "show or hide";
      button.setAttribute("aria-pressed", "true");
      swatch.className = "swatch";
      swatch.style.background = pair[1];
      button.append(swatch, pair[0]);
      button.addEventListener("click", function () {
        var on = button.getAttribute("aria-pressed") !== "true";
        button.setAttribute("aria-pressed", String(on));
        shown.renderers.forEach(function (r) { if (r.name === pair[0]) r.visible = on; });
      });
      box.append(button);
    });
    return box;
  }
  function again() { drawn.forEach(function (_, figure) { draw(figure); }); }
  function library() {
    var packed = document.getElementById("library");
    if (!packed || typeof DecompressionStream === "undefined") return Promise.resolve();
    var bytes = Uint8Array.from(atob(packed.textContent), function (c) { return c.charCodeAt(0); });
    var stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text().then(function (text) {
      var script = document.createElement("script");
      script.textContent = text;
      document.head.append(script);
    });
  }
  library().then(function () {
    if (typeof Bokeh === "undefined") return;
    Bokeh.set_log_level("error");
    var seen = new IntersectionObserver(function (entries) {
      entries.forEach(function (entry) {
        if (!entry.isIntersecting) return;
        seen.unobserve(entry.target);
        draw(entry.target);
      });
    }, {rootMargin: "300px"});
    document.querySelectorAll("figure").forEach(function (figure) {
      if (figure.querySelector("script.plot")) seen.observe(figure);
    });
    dark.addEventListener("change", again);
  });
  document.querySelectorAll(".scroll").forEach(function (box) {
    var rows = box.querySelectorAll("tbody tr");
    if (rows.length < LONG) return;
    var label = document.createElement("label"), input = document.createElement("input");
    label.className = "find";
    label.textContent = "Show rows with ";
    input.type = "search";
    label.append(input);
    box.before(label);
    input.addEventListener("input", function () {
      var wanted = input.value.toLowerCase();
      rows.forEach(function (row) { row.hidden = !row.textContent.toLowerCase().includes(wanted); });
    });
  });
})();
