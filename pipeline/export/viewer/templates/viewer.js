// The map of a run. Coordinates of the map are those of the project, (y, x) in metres; layers are image files loaded tile by tile.
(function () {
  "use strict";
  const $ = (id) => document.getElementById(id);
  const first = OM.layers[0];
  const finest = Math.min(...OM.layers.map((l) => l.cell));
  const MOST = 20; // zoom at which a pixel of the screen is the finest cell
  const a = 1 / (finest * 2 ** MOST);
  const crs = L.extend({}, L.CRS.Simple, { transformation: new L.Transformation(a, -first.west * a, -a, first.north * a) });
  const map = L.map("map", { crs, minZoom: 0, maxZoom: MOST + 3, zoomSnap: 0.25, zoomDelta: 0.5, wheelPxPerZoomLevel: 90, attributionControl: false, maxBoundsViscosity: 0.5 });
  const boundsOf = (l) => L.latLngBounds([l.north - l.rows * l.cell, l.west], [l.north, l.west + l.cols * l.cell]);
  map.fitBounds(boundsOf(first), { animate: false });
  map.setMinZoom(Math.max(0, map.getZoom() - 2));
  ["left", "right"].forEach((name, k) => { map.createPane(name).style.zIndex = 210 + k; });

  // Tiles that there are, as runs along the rows: (row, first column, last column, kind of file).
  function byRow(runs) {
    const rows = new Map();
    for (const run of runs) { if (!rows.has(run[0])) rows.set(run[0], []); rows.get(run[0]).push(run); }
    return rows;
  }
  const runAt = (rows, r, c) => (rows.get(r) || []).find(([, first, last]) => first <= c && c <= last);

  // A layer shows the tiles of the level that suits the zoom, over those of the coarsest level, which stay.
  class Tiles {
    constructor(layer, pane) {
      this.layer = layer; this.pane = pane; this.shown = new Map();
      this.known = Object.fromEntries(Object.entries(layer.levels).map(([level, runs]) => [level, byRow(runs)]));
      this.coarsest = Math.max(...Object.keys(layer.levels).map(Number), 0);
      this.update = this.update.bind(this);
      map.on("moveend zoomend", this.update); this.update();
    }
    level() {
      const metres = finest * 2 ** (MOST - map.getZoom()) / (window.devicePixelRatio || 1);
      return Math.min(this.coarsest, Math.max(0, Math.floor(Math.log2(metres / this.layer.cell) + 0.35)));
    }
    update() {
      const wanted = new Map(), view = map.getBounds().pad(0.15);
      for (const level of new Set([this.coarsest, this.level()])) {
        const l = this.layer, side = l.size * l.cell * 2 ** level;
        const r0 = Math.max(0, Math.floor((l.north - view.getNorth()) / side)), r1 = Math.floor((l.north - view.getSouth()) / side);
        const c0 = Math.max(0, Math.floor((view.getWest() - l.west) / side)), c1 = Math.floor((view.getEast() - l.west) / side);
        const rows = Math.ceil(l.rows * l.cell / side) - 1, cols = Math.ceil(l.cols * l.cell / side) - 1;
        for (let r = r0; r <= Math.min(r1, rows); r++) for (let c = c0; c <= Math.min(c1, cols); c++) {
          const run = this.known[level] && runAt(this.known[level], r, c);
          if (run) wanted.set(level + "/" + r + "-" + c + run[3], [level, r, c, side]);
        }
      }
      for (const [key, [level, r, c, side]] of wanted) if (!this.shown.has(key)) {
        const north = this.layer.north - r * side, west = this.layer.west + c * side;
        const image = L.imageOverlay(this.layer.folder + "/" + key, [[north - side, west], [north, west + side]],
          { pane: this.pane, className: "tile", zIndex: this.coarsest - level + 1 });
        this.shown.set(key, image.addTo(map));
      }
      // What is no longer wanted goes when the new tiles are there, so that nothing flickers.
      const old = [...this.shown.keys()].filter((key) => !wanted.has(key));
      const waiting = [...wanted.keys()].map((key) => this.shown.get(key).getElement()).filter((e) => e && !e.complete);
      const sweep = () => old.forEach((key) => { const i = this.shown.get(key); if (i) { i.remove(); this.shown.delete(key); } });
      if (!waiting.length) sweep(); else Promise.all(waiting.map((e) => new Promise((done) => { e.addEventListener("load", done); e.addEventListener("error", done); }))).then(() => { if (!this.gone) this.update(); });
    }
    remove() { this.gone = true; map.off("moveend zoomend", this.update); this.shown.forEach((i) => i.remove()); this.shown.clear(); }
  }

  // Layers, opacity and comparison.
  let left = null, right = null;
  function show(number) {
    if (left) left.remove();
    left = new Tiles(OM.layers[number], "left");
    legend(OM.layers[number]);
    document.body.classList.toggle("exact", OM.layers[number].style === "classes");
  }
  OM.layers.forEach((layer, k) => {
    const row = document.createElement("label"); row.className = "choice";
    const radio = Object.assign(document.createElement("input"), { type: "radio", name: "layer", checked: !k });
    radio.onchange = () => show(k);
    row.append(radio, layer.title); $("layers").append(row);
    $("other").add(new Option(layer.title, k));
  });
  $("other").add(new Option("nothing", "", true, true), 0); $("other").value = "";
  $("opacity").oninput = () => { map.getPane("left").style.opacity = map.getPane("right").style.opacity = $("opacity").value / 100; };
  $("other").onchange = () => {
    if (right) right.remove();
    right = $("other").value === "" ? null : new Tiles(OM.layers[+$("other").value], "right");
    $("divider").hidden = !right; clip();
  };
  let share = 0.5;
  function clip() {
    const box = map.getContainer().getBoundingClientRect(), x = share * box.width;
    $("divider").style.left = box.left + x + "px";
    const nw = map.containerPointToLayerPoint([0, 0]), se = map.containerPointToLayerPoint([box.width, box.height]);
    const cut = map.containerPointToLayerPoint([x, 0]).x;
    map.getPane("right").style.clip = right ? `rect(${nw.y}px,${se.x}px,${se.y}px,${cut}px)` : "";
  }
  map.on("move zoom resize", clip);
  $("divider").onpointerdown = (e) => { $("divider").setPointerCapture(e.pointerId); };
  $("divider").onpointermove = (e) => {
    if (!$("divider").hasPointerCapture(e.pointerId)) return;
    const box = map.getContainer().getBoundingClientRect();
    share = Math.min(0.98, Math.max(0.02, (e.clientX - box.left) / box.width)); clip();
  };
  const text = (tag, words, kind) => { const e = document.createElement(tag); e.textContent = words; if (kind) e.className = kind; return e; };
  function legend(layer) {
    const at = $("legend"), l = layer.legend; at.replaceChildren();
    if (l.classes.length) for (const [colour, meaning] of l.classes) {
      const row = text("div", "", "class"), box = document.createElement("i"); box.style.background = colour;
      row.append(box, meaning); at.append(row);
    }
    if (l.colours.length) {
      const bar = text("div", "", "bar"), ends = text("div", "", "ends"); bar.style.background = `linear-gradient(90deg,${l.colours})`;
      ends.append(text("span", number(l.low)), text("span", number(l.high) + " " + l.unit)); at.append(bar, ends);
    }
    if (layer.caption) at.append(text("p", layer.caption));
  }
  const number = (v) => (Math.abs(v) >= 100 ? v.toFixed(1) : v.toFixed(2));

  // Contours and edges: scripts that call omLines when they are asked for.
  const lines = {}, colours = { lines: "#7a4a1e", edges: "#e6007e" };
  const renderer = L.canvas({ padding: 0.3 });
  window.omLines = (name, west, south, rows) => {
    const group = lines[name] = L.layerGroup(), color = colours[name];
    for (const [height, dashed, label, steps] of rows) {
      let x = 0, y = 0; const places = [];
      for (let k = 0; k < steps.length; k += 2) { x += steps[k]; y += steps[k + 1]; places.push([south + y / 100, west + x / 100]); }
      group.addLayer(L.polyline(places, { renderer, color, weight: label || name === "edges" ? 1.8 : 0.9, dashArray: dashed ? "6 5" : null, interactive: false }));
      if (label && places.length > 40) {
        group.addLayer(L.marker(places[places.length >> 1], { icon: L.divIcon({ className: "label", html: label, iconSize: [40, 14] }), interactive: false }));
      }
    }
    if ($(name).checked) group.addTo(map);
  };
  for (const name in colours) {
    $(name + "row").hidden = !OM[name];
    $(name).onchange = () => {
      if (!lines[name]) return script(OM[name]);
      if ($(name).checked) lines[name].addTo(map); else lines[name].remove();
    };
  }
  const script = (path) => new Promise((done) => { const s = document.createElement("script"); s.src = path; s.onload = s.onerror = () => { s.remove(); done(); }; document.head.append(s); });

  // Photographs.
  const cameras = L.layerGroup(OM.cameras.flatMap((c) => {
    const mark = L.circleMarker([c.centre[1], c.centre[0]], { radius: 5, color: "#1f6f8b", fillOpacity: 0.8 });
    mark.bindTooltip(c.name + (c.taken ? ", " + c.taken : ""));
    const outline = L.polygon(c.outline.map(([x, y]) => [y, x]), { color: "#1f6f8b", weight: 1, fill: false, interactive: false });
    return [mark, outline];
  }));
  $("cameras").onchange = () => { if ($("cameras").checked) cameras.addTo(map); else cameras.remove(); };
  const within = (x, y, ring) => { let inside = false; for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) { const [xi, yi] = ring[i], [xj, yj] = ring[j]; if (yi > y !== yj > y && x < (xj - xi) * (y - yi) / (yj - yi) + xi) inside = !inside; } return inside; };

  // Values: tiles of packed numbers, unpacked when a place is asked for.
  const V = OM.values, tiles = new Map(), NOTHING = -(2 ** 31);
  const there = byRow(V ? V.tiles : []);
  window.omValues = (key, width, parts) => tiles.set(key, { width, parts, grids: {} });
  async function unpack(data, width) {
    const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const steps = new Int32Array(await new Response(stream).arrayBuffer());
    for (let k = 0; k < steps.length; k++) if (k % width) steps[k] = (steps[k] + steps[k - 1]) | 0;
    return steps;
  }
  async function valueAt(name, x, y) {
    const col = Math.floor((x - V.west) / V.cell), row = Math.floor((V.north - y) / V.cell);
    if (col < 0 || row < 0 || col >= V.cols || row >= V.rows) return null;
    const r = Math.floor(row / V.size), c = Math.floor(col / V.size), key = r + "-" + c;
    if (!runAt(there, r, c)) return null;
    if (!tiles.has(key)) await script(V.folder + "/" + key + ".js");
    const tile = tiles.get(key);
    if (!tile || !(name in tile.parts)) return null;
    if (!tile.grids[name]) tile.grids[name] = unpack(tile.parts[name], tile.width);
    const value = (await tile.grids[name])[(row % V.size) * tile.width + (col % V.size)];
    return value === NOTHING ? null : value;
  }
  const metres = (mm) => (mm === null ? null : mm / 1000);
  async function told(layer, x, y) {
    const [height, sigma, code] = await Promise.all(["height", "sigma", "code"].map((part) => valueAt(layer.name + "." + part, x, y)));
    return { height: metres(height), sigma: metres(sigma), code };
  }
  function answer(...parts) { $("told").replaceChildren(...parts); $("answer").hidden = false; }
  let asked = null;
  $("close").onclick = () => { $("answer").hidden = true; if (asked) asked.remove(); };
  async function place(latlng) {
    if (asked) asked.remove();
    asked = L.circleMarker(latlng, { radius: 6, color: "#d1495b", weight: 2, fill: false, interactive: false }).addTo(map);
    const x = latlng.lng, y = latlng.lat, table = document.createElement("table");
    const row = (...cells) => { const tr = document.createElement("tr"); cells.forEach((c) => tr.append(text("td", c))); table.append(tr); };
    row("X, Y", x.toFixed(2) + ", " + y.toFixed(2), "");
    for (const layer of V ? V.layers : []) {
      const t = await told(layer, x, y);
      if (t.height === null) { row(layer.title, "no height", ""); continue; }
      const meaning = (layer.codes.find(([code]) => code === t.code) || ["", "", ""])[2];
      row(layer.title, t.height.toFixed(2) + " m" + (t.sigma === null ? "" : " \u00b1 " + t.sigma.toFixed(2)), meaning);
    }
    const seen = OM.cameras.filter((c) => within(x, y, c.outline));
    row("Shown by", seen.length + " photographs", seen.slice(0, 12).map((c) => c.name).join(", ") + (seen.length > 12 ? " \u2026" : ""));
    const days = [...new Set(seen.map((c) => c.taken.slice(0, 10)).filter(Boolean))].sort();
    if (days.length) row("Taken", days[0] + (days.length > 1 ? " to " + days[days.length - 1] : ""), "");
    const shots = text("div", ""); shots.id = "shots";
    answer(table, shots);
    photographs(x, y, shots);
  }
  // The photographs themselves are only with `orthomill view`: a page on the disk reads no files beside it.
  async function photographs(x, y, shots) {
    if (location.protocol === "file:") return shots.append(text("small", "orthomill view " + OM.project + " shows the photographs here."));
    const wait = text("small", "Looking for the place in the photographs \u2026"); shots.append(wait);
    const found = await fetch(`place.json?x=${x}&y=${y}`).then((r) => (r.ok ? r.json() : [])).catch(() => []);
    wait.remove();
    for (const one of found) {
      const figure = text("figure", "", one.free ? "" : "hidden"), image = new Image();
      image.src = `crop.jpg?photo=${encodeURIComponent(one.photo)}&col=${one.col}&row=${one.row}&scale=2&size=118`;
      image.alt = one.photo; image.loading = "lazy";
      figure.append(image, text("figcaption", one.photo + (one.free ? "" : ", hidden there"))); shots.append(figure);
    }
  }

  // Profile: two clicks, the heights between them with their standard errors.
  let ends = null, drawn = null;
  $("profile").onclick = () => {
    ends = ends ? null : []; if (drawn) drawn.remove(); drawn = null;
    // The answer before it and, on a telephone, the menu lie over the map that is to be clicked.
    $("close").onclick(); $("panel").classList.remove("open");
    state();
  };
  function state() {
    $("profile").classList.toggle("on", !!ends);
    $("hint").textContent = ends ? (ends.length ? "Click on its end." : "Click on the beginning of the line.") : "Click on the map for the heights of a place.";
    if (ends) answer(text("div", $("hint").textContent));
    map.getContainer().style.cursor = ends ? "crosshair" : "";
  }
  map.on("click", (e) => {
    if (!ends) return place(e.latlng);
    ends.push(e.latlng);
    if (ends.length === 2) { profile(...ends); ends = null; }
    state();
  });
  async function profile(p, q) {
    drawn = L.polyline([p, q], { color: "#d1495b", weight: 3 }).addTo(map);
    const length = Math.hypot(q.lng - p.lng, q.lat - p.lat), parts = [text("div", "Length " + length.toFixed(2) + (V ? " \u00b1 " + (V.cell / Math.sqrt(6)).toFixed(2) : "") + " m in plan" + (V ? " (ends to a cell of " + V.cell + " m)" : ""))];
    if (V && length > 0) {
      const count = Math.min(400, Math.max(20, Math.round(length / V.cell))), found = [];
      for (const layer of V.layers) {
        const run = [];
        for (let k = 0; k <= count; k++) { const t = k / count; run.push(await told(layer, p.lng + t * (q.lng - p.lng), p.lat + t * (q.lat - p.lat))); }
        found.push([layer, run]);
      }
      parts.push(graph(found, length));
      for (const [layer, run] of found) {
        const one = run[0], two = run[count];
        if (one.height !== null && two.height !== null) parts.push(text("div", layer.title + ": " + one.height.toFixed(2) + " to " + two.height.toFixed(2) + " m, difference " + (two.height - one.height).toFixed(2) + " \u00b1 " + Math.hypot(one.sigma, two.sigma).toFixed(2) + " m"));
      }
    }
    answer(...parts);
  }
  function graph(found, length) {
    const W = 400, H = 170, B = 20, NS = "http://www.w3.org/2000/svg", svg = document.createElementNS(NS, "svg");
    svg.setAttribute("viewBox", `0 0 ${W} ${H}`); svg.style.width = "100%";
    const all = found.flatMap(([, run]) => run.filter((t) => t.height !== null).flatMap((t) => [t.height - t.sigma, t.height + t.sigma]));
    if (!all.length) return text("p", "No height along this line.");
    const low = Math.min(...all), high = Math.max(...all, low + 0.1), colours = ["#c1523c", "#2f6b33"];
    const X = (k, n) => 40 + (W - 50) * k / n, Y = (z) => 8 + (H - B - 12) * (high - z) / (high - low);
    const add = (tag, set, words) => { const e = document.createElementNS(NS, tag); for (const k in set) e.setAttribute(k, set[k]); if (words) e.textContent = words; svg.append(e); };
    found.forEach(([layer, run], which) => {
      const n = run.length - 1, colour = colours[which % 2]; let part = [];
      const flush = () => {
        if (part.length > 1) {
          const up = part.map(([k, t]) => `${X(k, n)},${Y(t.height + t.sigma)}`), down = part.map(([k, t]) => `${X(k, n)},${Y(t.height - t.sigma)}`).reverse();
          add("polygon", { points: [...up, ...down].join(" "), fill: colour, opacity: 0.2 });
          add("polyline", { points: part.map(([k, t]) => `${X(k, n)},${Y(t.height)}`).join(" "), fill: "none", stroke: colour, "stroke-width": 1.5 });
        }
        part = [];
      };
      run.forEach((t, k) => { if (t.height === null) flush(); else part.push([k, t]); }); flush();
      add("text", { x: 44 + which * 150, y: H - 4, fill: colour, "font-size": 11 }, layer.title);
    });
    for (const z of [low, high]) add("text", { x: 2, y: Y(z) + 4, "font-size": 10 }, z.toFixed(1));
    add("text", { x: W - 8, y: H - 4, "font-size": 10, "text-anchor": "end" }, length.toFixed(1) + " m");
    return svg;
  }

  const bar = L.control({ position: "bottomleft" });
  bar.onAdd = () => { const e = text("div", "", "leaflet-control-scale-line"); bar.element = e; return e; };
  function scale() {
    const perPixel = finest * 2 ** (MOST - map.getZoom()), most = 140 * perPixel, power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map((m) => m * power).find((m) => m <= most);
    bar.element.style.width = length / perPixel + "px"; bar.element.textContent = length >= 1000 ? length / 1000 + " km" : length + " m";
  }
  bar.addTo(map); map.on("zoom", scale); scale();
  $("system").textContent = OM.system;
  $("menu").onclick = () => $("panel").classList.toggle("open");
  show(0);
  window.om = { map, valueAt, show };
})();
