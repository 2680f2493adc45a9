// The surface as points in space: turned by dragging, moved with two fingers or the right button, nearer by the wheel.
(function () {
  "use strict";
  if (!OM.cloud) return;
  const $ = (id) => document.getElementById(id);
  const button = $("space"), pane = $("spacepane"), canvas = $("spacecanvas");
  $("spacerow").hidden = false;
  const VERTEX = `attribute vec3 place; attribute vec3 colour; uniform mat4 view; uniform float size, high; varying vec3 shade;
    void main() { vec4 at = view * vec4(place.xy, place.z * high, 1.0); gl_Position = at; gl_PointSize = clamp(size / at.w, 1.0, 24.0); shade = colour; }`;
  const FRAGMENT = "precision mediump float; varying vec3 shade; void main() { gl_FragColor = vec4(shade, 1.0); }";
  let gl = null, program = null, cloud = null, waiting = false;
  const eye = { turn: 0.6, tilt: 0.7, far: 1, x: 0, y: 0 };
  const say = (words) => { $("spacetold").textContent = words; };
  function shader(kind, text) {
    const s = gl.createShader(kind); gl.shaderSource(s, text); gl.compileShader(s);
    if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s));
    return s;
  }
  function start() {
    gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
    if (!gl) { say("This browser has no WebGL, which points in space need."); return false; }
    program = gl.createProgram();
    gl.attachShader(program, shader(gl.VERTEX_SHADER, VERTEX)); gl.attachShader(program, shader(gl.FRAGMENT_SHADER, FRAGMENT));
    gl.linkProgram(program); gl.useProgram(program); gl.enable(gl.DEPTH_TEST); gl.clearColor(0.93, 0.92, 0.89, 1);
    return true;
  }
  window.omCloud = async (c) => {
    const bytes = Uint8Array.from(atob(c.data), (ch) => ch.charCodeAt(0));
    const all = await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
    const n = c.count, cols = new Uint16Array(all, 0, n), rows = new Uint16Array(all, 2 * n, n), steps = new Uint16Array(all, 4 * n, n);
    const rgb = [6 * n, 7 * n, 8 * n].map((at) => new Uint8Array(all, at, n));
    const places = new Float32Array(3 * n), colours = new Uint8Array(3 * n), middle = (c.low + c.high) / 2;
    for (let k = 0; k < n; k++) {
      places[3 * k] = (cols[k] - c.cols / 2) * c.cell; places[3 * k + 1] = (c.rows / 2 - rows[k]) * c.cell;
      places[3 * k + 2] = c.low + (c.high - c.low) * steps[k] / 65535 - middle;
      for (let b = 0; b < 3; b++) colours[3 * k + b] = rgb[b][k];
    }
    for (const [name, data, kind, exact] of [["place", places, gl.FLOAT, false], ["colour", colours, gl.UNSIGNED_BYTE, true]]) {
      const at = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(at); gl.vertexAttribPointer(at, 3, kind, exact, 0, 0);
    }
    cloud = c; eye.far = 0.75 * Math.max(c.cols, c.rows) * c.cell;
    say(n.toLocaleString("en") + " points, one every " + c.cell.toFixed(2) + " m, measured heights only");
    draw();
  };
  const product = (a, b) => { const o = new Float32Array(16); for (let r = 0; r < 4; r++) for (let c = 0; c < 4; c++) for (let k = 0; k < 4; k++) o[4 * c + r] += a[4 * k + r] * b[4 * c + k]; return o; };
  function matrix() {
    const w = canvas.width, h = canvas.height, f = 1 / Math.tan(0.45), near = eye.far / 100, far = eye.far * 20;
    const lens = [f * h / w, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
    const ct = Math.cos(eye.turn), st = Math.sin(eye.turn), cv = Math.cos(eye.tilt), sv = Math.sin(eye.tilt);
    // Columns: where east, north and up lie on the screen (right, up, towards the viewer).
    const turned = [ct, -st * sv, st * cv, 0, st, ct * sv, -ct * cv, 0, 0, cv, sv, 0, 0, 0, 0, 1];
    const away = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -eye.far, 1];
    const moved = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -eye.x, -eye.y, 0, 1];
    return product(lens, product(away, product(turned, moved)));
  }
  function draw() {
    waiting = false;
    if (!cloud || pane.hidden) return;
    const ratio = window.devicePixelRatio || 1, w = Math.round(canvas.clientWidth * ratio), h = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    gl.viewport(0, 0, w, h); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "view"), false, matrix());
    gl.uniform1f(gl.getUniformLocation(program, "size"), 1.3 * cloud.cell * h / (2 * Math.tan(0.45)));
    gl.uniform1f(gl.getUniformLocation(program, "high"), +$("spacehigh").value);
    gl.drawArrays(gl.POINTS, 0, cloud.count);
  }
  const soon = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };
  const held = new Map(); let apart = 0;
  const turn = (dx, dy) => { eye.turn += dx * 0.006; eye.tilt = Math.min(1.56, Math.max(0.02, eye.tilt + dy * 0.006)); };
  const move = (dx, dy) => {
    const s = eye.far / canvas.clientHeight, ct = Math.cos(eye.turn), st = Math.sin(eye.turn);
    eye.x -= s * (dx * ct + dy * st); eye.y -= s * (dx * st - dy * ct);
  };
  canvas.onpointerdown = (e) => { canvas.setPointerCapture(e.pointerId); held.set(e.pointerId, e); apart = 0; };
  canvas.onpointerup = canvas.onpointercancel = (e) => { held.delete(e.pointerId); apart = 0; };
  canvas.onpointermove = (e) => {
    const before = held.get(e.pointerId); if (!before) return;
    const dx = e.clientX - before.clientX, dy = e.clientY - before.clientY; held.set(e.pointerId, e);
    if (held.size === 2) {
      const [a, b] = [...held.values()], now = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
      if (apart) eye.far *= apart / now;
      apart = now; move(dx / 2, dy / 2);
    } else if (e.buttons & 2 || e.shiftKey) move(dx, dy); else turn(dx, dy);
    soon();
  };
  canvas.oncontextmenu = (e) => e.preventDefault();
  canvas.onwheel = (e) => { e.preventDefault(); eye.far *= Math.exp(e.deltaY * 0.001); soon(); };
  $("spacehigh").oninput = soon; window.addEventListener("resize", soon);
  button.onclick = () => {
    pane.hidden = !pane.hidden; button.classList.toggle("on", !pane.hidden);
    if (pane.hidden) return;
    $("panel").classList.remove("open");
    if (!gl) { say("Loading \u2026"); if (!start()) return; const s = document.createElement("script"); s.src = OM.cloud; document.head.append(s); }
    soon();
  };
  $("spaceclose").onclick = () => button.onclick();
  window.omSpace = { draw: soon, eye };
})();
