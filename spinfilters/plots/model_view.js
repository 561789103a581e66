"use strict";
// A model that is turned with the mouse: triangles or points with a depth buffer, drawn without a graphics card (orthographic).
(() => {
  const canvas = document.getElementById("model-view"), slider = document.getElementById("model-epoch");
  const label = document.getElementById("model-time"), play = document.getElementById("model-play");
  const told = JSON.parse(document.getElementById("model-data").textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const vertices = new Int16Array(bytes(told.vertices)), triangles = new Uint32Array(bytes(told.triangles));
  const grey = new Uint8Array(bytes(told.grey)), poses = told.poses, context = canvas.getContext("2d");
  const width = canvas.width, height = canvas.height, count = vertices.length / 3, unit = told.unit;
  const depth = new Float32Array(width * height), at = new Float32Array(count * 3);
  let view = multiply(turn(0, -0.45), turn(1, 0.6)), zoom = 1, epoch = -1, drag = null, timer = null;

  function turn(axis, angle) {
    const c = Math.cos(angle), s = Math.sin(angle);
    return axis === 0 ? [1, 0, 0, 0, c, -s, 0, s, c] : [c, 0, s, 0, 1, 0, -s, 0, c];
  }
  function multiply(a, b) {
    const product = new Array(9);
    for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++)
      product[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    return product;
  }
  function rotated(m, x, y, z) {
    return [m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z, m[6] * x + m[7] * y + m[8] * z];
  }
  function triangle(pixels, a, b, c) {
    const ax = at[a], ay = at[a + 1], bx = at[b], by = at[b + 1], cx = at[c], cy = at[c + 1];
    const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    if (area >= 0) return; // seen from behind: z points away
    const nx = (by - ay) * (at[c + 2] - at[a + 2]) - (at[b + 2] - at[a + 2]) * (cy - ay);
    const ny = (at[b + 2] - at[a + 2]) * (cx - ax) - (bx - ax) * (at[c + 2] - at[a + 2]);
    const light = 0.55 + 0.45 * (-0.4 * nx - 0.4 * ny - 0.82 * area) / Math.hypot(nx, ny, area);
    const left = Math.max(0, Math.ceil(Math.min(ax, bx, cx))), right = Math.min(width - 1, Math.floor(Math.max(ax, bx, cx)));
    const top = Math.max(0, Math.ceil(Math.min(ay, by, cy))), bottom = Math.min(height - 1, Math.floor(Math.max(ay, by, cy)));
    const ga = grey[a / 3], gb = grey[b / 3], gc = grey[c / 3];
    for (let y = top; y <= bottom; y++) for (let x = left; x <= right; x++) {
      const u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area, v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area;
      if (u < 0 || v < 0 || u + v > 1) continue;
      const z = u * at[a + 2] + v * at[b + 2] + (1 - u - v) * at[c + 2], pixel = y * width + x;
      if (z >= depth[pixel]) continue;
      depth[pixel] = z;
      const value = Math.min(255, light * (30 + 1.25 * (u * ga + v * gb + (1 - u - v) * gc)));
      pixels[pixel] = 0xff000000 | (value << 16) | (value << 8) | value;
    }
  }
  function point(pixels, k) {
    const x0 = Math.round(at[k]), y0 = Math.round(at[k + 1]), value = 110 + 0.57 * grey[k / 3];
    for (let y = y0; y < y0 + 2; y++) for (let x = x0; x < x0 + 2; x++) {
      if (x < 0 || y < 0 || x >= width || y >= height || at[k + 2] >= depth[y * width + x]) continue;
      depth[y * width + x] = at[k + 2];
      pixels[y * width + x] = 0xff000000 | (value << 16) | (value << 8) | (value * 0.8);
    }
  }
  function arrow(origin, vector, length, scale, colour, name) {
    const q = rotated(view, ...vector), tip = [origin[0] + scale * length * q[0], origin[1] + scale * length * q[1]];
    line(origin, tip, colour, 2.5);
    context.fillStyle = colour; context.font = "13px sans-serif"; context.fillText(name, tip[0] + 4, tip[1] - 4);
  }
  function camera(on, size) { // a pyramid from the origin of i along its z
    const corners = [[-1, -0.75], [1, -0.75], [1, 0.75], [-1, 0.75]].map(([x, y]) => on([size * x, size * y, 1.6 * size]));
    corners.forEach((corner, k) => { line(on([0, 0, 0]), corner, "#9aa5ad", 1.2); line(corner, corners[(k + 1) % 4], "#9aa5ad", 1.2); });
    context.fillStyle = "#9aa5ad"; context.font = "13px sans-serif";
    const at = on([0, 0, 0]); context.fillText("frame i", at[0] + 6, at[1] + 14);
  }
  function bar(scale) { // a round length in metres
    const raw = 0.2 * width / scale, power = 10 ** Math.floor(Math.log10(raw));
    const length = [5, 2, 1].map((k) => k * power).find((k) => k <= raw), y = height - 18;
    line([18, y], [18 + length * scale, y], "#e3e7ea", 2);
    context.fillStyle = "#e3e7ea"; context.font = "13px sans-serif";
    context.fillText(length >= 1 ? length + " m" : length >= 0.01 ? Math.round(100 * length) + " cm" : Number((1000 * length).toPrecision(1)) + " mm", 18, y - 6);
  }
  function line(from, to, colour, thickness) {
    context.strokeStyle = colour; context.lineWidth = thickness; context.beginPath();
    context.moveTo(from[0], from[1]); context.lineTo(to[0], to[1]); context.stroke();
  }
  function draw() {
    const pose = epoch < 0 ? null : poses[epoch], place = pose ? pose.slice(10) : [0, 0, 0];
    const body = pose ? multiply(view, pose.slice(1, 10)) : view;
    const reach = pose ? told.reach : told.radius, middle = pose ? told.middle : [0, 0, 0];
    const scale = 0.46 * Math.min(width, height) * zoom / reach;
    const on = (p) => { const q = rotated(view, p[0] - middle[0], p[1] - middle[1], p[2] - middle[2]);
      return [width / 2 + scale * q[0], height / 2 + scale * q[1], scale * q[2]]; };
    const origin = on(place), image = context.createImageData(width, height), pixels = new Uint32Array(image.data.buffer);
    pixels.fill(0xff1c1814); depth.fill(Infinity);
    for (let k = 0; k < 3 * count; k += 3) {
      const q = rotated(body, vertices[k] * unit, vertices[k + 1] * unit, vertices[k + 2] * unit);
      for (let i = 0; i < 3; i++) at[k + i] = origin[i] + scale * q[i];
    }
    if (triangles.length) for (let k = 0; k < triangles.length; k += 3)
      triangle(pixels, 3 * triangles[k], 3 * triangles[k + 1], 3 * triangles[k + 2]);
    else for (let k = 0; k < 3 * count; k += 3) point(pixels, k);
    context.putImageData(image, 0, 0);
    if (pose) for (let k = 1; k < poses.length; k++)
      line(on(poses[k - 1].slice(10)), on(poses[k].slice(10)), k <= epoch ? "#56b4e9" : "#3a444c", 1.5);
    ["#e0603a", "#2fa36b", "#4a90d9"].forEach((colour, axis) => {
      const end = rotated(body, ...[0, 1, 2].map((k) => (k === axis ? 1.15 * told.radius : 0)));
      const tip = [origin[0] + scale * end[0], origin[1] + scale * end[1]];
      line(origin, tip, colour, 1.5);
      context.fillStyle = colour; context.font = "13px sans-serif"; context.fillText("xyz"[axis], tip[0] + 4, tip[1] + 4);
    });
    for (let k = 1; k < told.polhode.length; k++) {
      const [from, to] = [k - 1, k].map((j) => rotated(body, ...told.polhode[j].map((x) => 1.1 * told.radius * x)));
      line([origin[0] + scale * from[0], origin[1] + scale * from[1]], [origin[0] + scale * to[0], origin[1] + scale * to[1]], "#e8a94c", 1.5);
    }
    if (pose && told.momentum.length) arrow(origin, told.momentum[epoch], 1.5 * told.radius, scale, "#f0e442", "momentum");
    if (pose && told.rate.length) arrow(origin, told.rate[epoch], 1.1 * told.radius, scale, "#e8a94c", "rate");
    if (told.metric && pose) camera(on, 0.3 * told.radius);
    if (told.metric && (pose || told.sized)) bar(scale); // alone, a body of unknown size has no length
    label.textContent = pose ? "t = " + pose[0].toFixed(2) + " s, seen along z of frame i before you turn it" : "principal axes";
    canvas.dataset.drawn = String(pixels.reduce((sum, value) => sum + (value !== 0xff1c1814), 0));
  }
  canvas.addEventListener("pointerdown", (event) => { drag = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointerup", () => { drag = null; });
  canvas.addEventListener("pointermove", (event) => {
    if (!drag) return;
    view = multiply(multiply(turn(1, (drag[0] - event.clientX) * 0.008), turn(0, (event.clientY - drag[1]) * 0.008)), view);
    drag = [event.clientX, event.clientY]; draw();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault(); zoom = Math.min(20, Math.max(0.2, zoom * Math.exp(-0.001 * event.deltaY))); draw();
  }, { passive: false });
  slider.max = String(poses.length - 1);
  slider.addEventListener("input", () => {
    const next = Number(slider.value);
    if ((epoch < 0) !== (next < 0)) view = next < 0 ? multiply(turn(0, -0.45), turn(1, 0.6)) : [1, 0, 0, 0, 1, 0, 0, 0, 1];
    epoch = next; draw();
  });
  play.addEventListener("click", () => {
    if (timer) { clearInterval(timer); timer = null; play.textContent = "play"; return; }
    play.textContent = "stop";
    timer = setInterval(() => {
      slider.value = String(epoch + 1 < poses.length ? epoch + 1 : 0); slider.dispatchEvent(new Event("input"));
    }, 100);
  });
  draw();
})();
