// Plays the frames of a run in a MeshCat scene, with its energies beside it.
//
// A frame is a row of numbers: time, seven for the pose of each node, six for each arrow (origin and vector),
// one for each value, three for the point that leaves a trail. Recorded frames are in the page; live ones come
// over a socket, and stay, so that a run can be played again when it has ended.
"use strict";
(function () {
  const run = JSON.parse(document.getElementById("run").textContent);
  const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
  const THREE = MeshCat.THREE;
  const element = (id) => document.getElementById(id);

  const columns = {};
  columns.nodes = 1;
  columns.arrows = columns.nodes + 7 * run.nodes.length;
  columns.values = columns.arrows + 6 * run.arrows.length;
  columns.trail = columns.values + run.values.length;
  columns.image = columns.trail + 3;
  columns.count = columns.image + (run.image ? run.image.columns : 0);

  const frames = [];
  let time = 0, playing = false, following = run.live, drawn = -1;

  // --- the scene ------------------------------------------------------------------------------------------

  function decode(text, kind) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return new kind(bytes.buffer);
  }

  function geometryOf(shape) {
    if (shape.kind === "box") return new THREE.BoxGeometry(...shape.size);
    if (shape.kind === "sphere") return new THREE.SphereGeometry(shape.size[0], 32, 20);
    if (shape.kind === "cylinder") {  // along y in three.js, along z in a URDF
      return new THREE.CylinderGeometry(shape.size[0], shape.size[0], shape.size[1], 36).rotateX(Math.PI / 2);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(decode(shape.points, Float32Array), 3));
    if (shape.kind === "mesh") {
      geometry.setIndex(new THREE.BufferAttribute(decode(shape.faces, Uint32Array), 1));
      geometry.computeVertexNormals();
    }
    return geometry;
  }

  function materialOf(rgba, kind) {
    const color = new THREE.Color(rgba[0], rgba[1], rgba[2]);
    if (kind === "lines") return new THREE.LineBasicMaterial({ color });
    const see = rgba[3] < 1;
    return new THREE.MeshPhongMaterial(
      { color, opacity: rgba[3], transparent: see, depthWrite: !see, side: THREE.DoubleSide, shininess: 25,
        // what is seen through lies behind what it coincides with: a ghost that is reached vanishes
        polygonOffset: see, polygonOffsetFactor: 2, polygonOffsetUnits: 4 });
  }

  function place(object, pose) {
    object.position.set(pose[0], pose[1], pose[2]);
    object.quaternion.set(pose[3], pose[4], pose[5], pose[6]);
  }

  const geometries = run.shapes.map(geometryOf);
  const nodes = run.nodes.map((node) => {
    const path = node.path.split("/");
    node.shapes.forEach((entry, i) => {
      const shape = run.shapes[entry.shape];
      const material = materialOf(entry.color, shape.kind);
      const kind = shape.kind === "lines" ? THREE.LineSegments : THREE.Mesh;
      const object = new kind(geometries[entry.shape], material);
      place(object, shape.pose);
      viewer.set_object(path.concat(["shape" + i]), object);
    });
    return viewer.scene_tree.find(path).object;
  });

  // seen through everything: a force inside a body is still a force
  const arrowMaterial = new THREE.MeshPhongMaterial({ color: 0xc01818, depthTest: false, transparent: true });
  const arrows = run.arrows.map((arrow, i) => {
    const group = new THREE.Group();
    const shaft = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 1, 16).translate(0, 0.5, 0), arrowMaterial);
    const head = new THREE.Mesh(new THREE.ConeGeometry(1, 1, 24).translate(0, 0.5, 0), arrowMaterial);
    group.add(shaft, head);
    viewer.set_object(["forces", "arrow" + i], group);
    return { group, shaft, head };
  });

  const TRAIL = 6000;
  const trail = new THREE.BufferGeometry();
  trail.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * TRAIL), 3));
  const line = new THREE.Line(trail, new THREE.LineBasicMaterial({ color: 0x0072b2 }));
  line.frustumCulled = false;
  viewer.set_object(["trail"], line);

  function lookAtScene() {
    viewer.set_property(["Background"], "top_color", [0.96, 0.97, 0.98]);
    viewer.set_property(["Background"], "bottom_color", [0.80, 0.83, 0.87]);
    const radius = run.radius, [x, y, z] = run.center;
    const grid = new THREE.GridHelper(8 * radius, 32, 0x9aa0a8, 0xc3c7cd);
    grid.rotateX(Math.PI / 2);
    viewer.set_object(["Grid"], grid);
    viewer.set_object(["Axes"], new THREE.AxesHelper(0.25 * radius));
    // the camera lives in axes whose y points up: (x, y, z) of the world is (x, z, −y) there
    const away = 3.0 * radius, direction = new THREE.Vector3(0.80, 0.38, 0.55).normalize();
    // a little beside the middle: the panel covers the left
    viewer.controls.target.set(x, z, -y);
    viewer.camera.position.set(x, z, -y).addScaledVector(direction, away);
    viewer.camera.fov = 40;
    viewer.camera.near = radius / 100;
    viewer.camera.setViewOffset && window.innerWidth > 800 &&
      viewer.camera.setViewOffset(window.innerWidth, window.innerHeight, -120, 20, window.innerWidth, window.innerHeight);
    viewer.camera.updateProjectionMatrix();
    viewer.controls.update();
  }

  // --- one moment -----------------------------------------------------------------------------------------

  function indexAt(moment) {
    let low = 0, high = frames.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (frames[middle][0] <= moment) low = middle; else high = middle - 1;
    }
    return low;
  }

  const between = new Float64Array(columns.count);
  function frameAt(moment) {
    const i = indexAt(moment), before = frames[i], after = frames[Math.min(i + 1, frames.length - 1)];
    const gap = after[0] - before[0];
    const part = gap > 0 ? Math.min(1, Math.max(0, (moment - before[0]) / gap)) : 0;
    for (let c = 0; c < columns.count; c++) between[c] = before[c] + part * (after[c] - before[c]);
    for (let n = 0; n < nodes.length; n++) {  // quaternions: the short way, made unit again
      const at = columns.nodes + 7 * n + 3;
      let dot = 0, norm = 0;
      for (let c = at; c < at + 4; c++) dot += before[c] * after[c];
      for (let c = at; c < at + 4; c++) {
        between[c] = before[c] + part * ((dot < 0 ? -after[c] : after[c]) - before[c]);
        norm += between[c] * between[c];
      }
      for (let c = at; c < at + 4; c++) between[c] /= Math.sqrt(norm);
    }
    return [i, between];
  }

  let strongest = {};
  function noteForces(frame) {
    run.arrows.forEach((arrow, i) => {
      const at = columns.arrows + 6 * i + 3;
      const size = Math.hypot(frame[at], frame[at + 1], frame[at + 2]);
      strongest[arrow.unit] = Math.max(strongest[arrow.unit] || 0, size);
    });
  }

  function scaleOf(unit) {  // metres a newton, one, two or five times a power of ten
    const desired = 0.5 * run.radius / (strongest[unit] || 1);
    const power = Math.pow(10, Math.floor(Math.log10(desired)));
    return power * (desired >= 5 * power ? 5 : desired >= 2 * power ? 2 : 1);
  }

  const up = new THREE.Vector3(0, 1, 0), along = new THREE.Vector3();
  function drawArrows(frame) {
    arrows.forEach((parts, i) => {
      const at = columns.arrows + 6 * i, length0 = Math.hypot(frame[at + 3], frame[at + 4], frame[at + 5]);
      const length = length0 * scaleOf(run.arrows[i].unit);
      parts.group.visible = length > 1e-3 * run.radius;
      if (!parts.group.visible) return;
      along.set(frame[at + 3], frame[at + 4], frame[at + 5]).normalize();
      parts.group.position.set(frame[at], frame[at + 1], frame[at + 2]);
      parts.group.quaternion.setFromUnitVectors(up, along);
      const thick = 0.012 * run.radius, head = Math.min(0.1 * run.radius, 0.5 * length);
      parts.shaft.scale.set(thick, length - head, thick);
      parts.head.scale.set(2.5 * thick, head, 2.5 * thick);
      parts.head.position.set(0, length - head, 0);
    });
  }

  function drawTrail(index, frame) {
    const step = Math.ceil((frames.length + 1) / (TRAIL - 1)), places = trail.attributes.position;
    let count = 0;
    for (let i = 0; i <= index; i += step) {
      const row = frames[i], at = columns.trail;
      places.setXYZ(count++, row[at], row[at + 1], row[at + 2]);
    }
    places.setXYZ(count++, frame[columns.trail], frame[columns.trail + 1], frame[columns.trail + 2]);
    places.needsUpdate = true;
    trail.setDrawRange(0, count);
  }

  function show(moment) {
    if (frames.length === 0) return;
    time = Math.min(Math.max(moment, frames[0][0]), frames[frames.length - 1][0]);
    const [index, frame] = frameAt(time);
    nodes.forEach((object, n) => place(object, frame.subarray(columns.nodes + 7 * n, columns.nodes + 7 * n + 7)));
    drawArrows(frame);
    drawTrail(index, frame);
    drawCharts(index, frame);
    if (run.image) drawImage(index, frame);
    element("clock").textContent = time.toFixed(2) + " s of " + frames[frames.length - 1][0].toFixed(2);
    const scrub = element("scrub");
    scrub.min = frames[0][0];
    scrub.max = Math.max(frames[frames.length - 1][0], frames[0][0] + 1e-6);
    scrub.value = time;
    viewer.set_dirty();
    drawn = frames.length;
  }

  // --- energies -------------------------------------------------------------------------------------------

  const charts = [];
  run.values.forEach((value, i) => {
    let chart = charts[value.chart];
    if (!chart) {
      const box = document.createElement("div");
      box.className = "chart";
      const canvas = document.createElement("canvas");
      box.append(canvas);
      element("charts").append(box);
      chart = charts[value.chart] = { box, canvas, values: [], low: Infinity, high: -Infinity, floats: value.floats };
    }
    const label = document.createElement("div");
    label.className = "value";
    const name = document.createElement("span"), mark = document.createElement("i"), number = document.createElement("b");
    mark.style.background = value.color;
    name.append(mark, value.label);
    label.append(name, number);
    chart.box.insertBefore(label, chart.canvas);
    chart.values.push({ column: columns.values + i, color: value.color, unit: value.unit, number });
  });

  function noteValues(frame) {
    for (const chart of charts.filter(Boolean)) for (const value of chart.values) {
      chart.low = Math.min(chart.low, frame[value.column]);
      chart.high = Math.max(chart.high, frame[value.column]);
    }
  }

  function readable(number) {
    const size = Math.abs(number);
    return size !== 0 && (size < 1e-3 || size >= 1e5) ? number.toExponential(2) : number.toPrecision(4);
  }

  function prepare(canvas, height) {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth || 266;
    if (canvas.width !== Math.round(width * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    return [pen, width];
  }

  function drawCharts(index, frame) {
    const start = frames[0][0], span = Math.max(1e-9, frames[frames.length - 1][0] - start);
    const step = Math.max(1, Math.floor(frames.length / 600));
    for (const chart of charts.filter(Boolean)) {
      const height = 64, [pen, width] = prepare(chart.canvas, height);
      const low = chart.floats ? chart.low : Math.min(chart.low, 0), high = chart.high > low ? chart.high : low + 1;
      const x = (t) => ((t - start) / span) * (width - 2) + 1, y = (v) => height - 3 - ((v - low) / (high - low)) * (height - 6);
      pen.strokeStyle = "#d5d8dd";
      pen.beginPath();
      pen.moveTo(0, y(Math.max(low, 0)));
      pen.lineTo(width, y(Math.max(low, 0)));
      pen.stroke();
      for (const value of chart.values) {
        value.number.textContent = readable(frame[value.column]) + " " + value.unit;
        for (const [from, to, alpha] of [[index, frames.length - 1, 0.22], [0, index, 1]]) {
          pen.globalAlpha = alpha;
          pen.strokeStyle = value.color;
          pen.lineWidth = 1.5;
          pen.beginPath();
          for (let i = from; i <= to; i += step) pen.lineTo(x(frames[i][0]), y(frames[i][value.column]));
          if (alpha === 1) pen.lineTo(x(time), y(frame[value.column]));
          pen.stroke();
        }
        pen.globalAlpha = 1;
        pen.fillStyle = value.color;
        pen.beginPath();
        pen.arc(x(time), y(frame[value.column]), 3, 0, 7);
        pen.fill();
      }
    }
    element("arrows").textContent = [...new Set(run.arrows.map((arrow) => arrow.unit))]
      .map((unit) => "arrows: 1 " + unit + " is " + readable(1000 * scaleOf(unit)) + " mm").join("; ");
  }

  // --- what the camera sees -------------------------------------------------------------------------------

  function drawImage(index, frame) {
    const canvas = element("image"), image = run.image, ratio = image.height / image.width;
    canvas.hidden = false;
    const height = 266 * ratio, [pen, width] = prepare(canvas, height);
    canvas.style.height = height + "px";
    const x = (mu) => width * (0.5 + mu / image.width), y = (nu) => height * (0.5 + nu / image.height);
    const bar = (mu, nu, length, color, thick) => {
      pen.strokeStyle = color;
      pen.lineWidth = thick;
      pen.beginPath();
      pen.moveTo(x(mu - length / 2), y(nu));
      pen.lineTo(x(mu + length / 2), y(nu));
      pen.stroke();
    };
    pen.strokeStyle = "rgba(26, 153, 89, 0.5)";
    pen.lineWidth = 1;
    pen.beginPath();
    for (let i = 0; i <= index; i++) pen.lineTo(x(frames[i][columns.image]), y(frames[i][columns.image + 1]));
    pen.stroke();
    if (image.goal) bar(image.goal[0], image.goal[1], image.goal[2], "rgba(0, 114, 178, 0.40)", 9);
    bar(frame[columns.image], frame[columns.image + 1], frame[columns.image + 2], "#1a9959", 4);
    pen.fillStyle = "#30343b";
    pen.font = "11px system-ui, sans-serif";
    pen.fillText("image plane: object (green), goal (blue)", 6, 14);
  }

  // --- playing --------------------------------------------------------------------------------------------

  let last = null;
  function tick(now) {
    if (following) {
      if (frames.length !== drawn && frames.length) show(frames[frames.length - 1][0]);
    } else if (playing && frames.length) {
      const passed = last === null ? 0 : (now - last) / 1000;
      const end = frames[frames.length - 1][0];
      show(time + passed * Number(element("speed").value));
      if (time >= end) setPlaying(false);
    }
    last = now;
    window.requestAnimationFrame(tick);
  }

  function setPlaying(on) {
    playing = on;
    element("play").textContent = on ? "❚❚" : "▶";
  }

  function setFollowing(on) {
    following = on;
    element("live").classList.toggle("on", on);
  }

  function play() {
    setFollowing(false);
    if (frames.length && time >= frames[frames.length - 1][0]) show(frames[0][0]);
    setPlaying(true);
  }

  function seek(moment) {
    setFollowing(false);
    setPlaying(false);
    show(moment);
  }

  element("play").addEventListener("click", () => (playing ? setPlaying(false) : play()));
  element("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
  element("live").addEventListener("click", () => { setPlaying(false); setFollowing(true); drawn = -1; });
  window.addEventListener("keydown", (event) => {
    if (event.code === "Space" && event.target.tagName !== "BUTTON") {
      event.preventDefault();
      if (playing) setPlaying(false); else play();
    } else if (event.code === "ArrowRight" || event.code === "ArrowLeft") {
      if (event.target.tagName !== "INPUT") seek(time + (event.code === "ArrowRight" ? 0.1 : -0.1));
    }
  });

  function take(rows) {
    for (let at = 0; at + columns.count <= rows.length; at += columns.count) {
      const frame = rows.subarray(at, at + columns.count);
      if (frames.length && frame[0] <= frames[frames.length - 1][0]) continue;
      frames.push(frame);
      noteForces(frame);
      noteValues(frame);
    }
  }

  // --- what may be changed while it runs ------------------------------------------------------------------

  let socket = null;
  const handles = {};
  const parts = {};  // sliders by the part of the setpoint that they are of

  function ask(part) {
    if (!socket || socket.readyState !== WebSocket.OPEN) return;
    socket.send(JSON.stringify({ part, values: parts[part].map((slider) => Number(slider.input.value)) }));
  }

  function setSlider(slider, value) {
    slider.input.value = Math.min(slider.high, Math.max(slider.low, value));
    slider.output.textContent = readable(Number(slider.input.value)) + " " + slider.unit;
  }

  function placeHandle(part) {  // where the hand is asked to be
    if (handles[part]) handles[part].position.set(...parts[part].slice(0, 3).map((slider) => Number(slider.input.value)));
    viewer.set_dirty();
  }

  function makeControls() {
    const form = element("controls");
    form.hidden = false;
    form.addEventListener("submit", (event) => event.preventDefault());
    for (const entry of run.controls.sliders) {
      if (!parts[entry.part]) {
        parts[entry.part] = [];
        const heading = document.createElement("h2");
        heading.textContent = entry.part;
        form.append(heading);
      }
      const label = document.createElement("label"), name = document.createElement("span");
      const slider = Object.assign({ input: document.createElement("input"), output: document.createElement("output") }, entry);
      name.textContent = entry.label;
      Object.assign(slider.input, { type: "range", min: entry.low, max: entry.high, step: "any" });
      slider.input.setAttribute("aria-label", entry.part + " " + entry.label);
      slider.input.addEventListener("input", () => { setSlider(slider, Number(slider.input.value)); placeHandle(entry.part); ask(entry.part); });
      label.append(name, slider.input, slider.output);
      form.append(label);
      parts[entry.part].push(slider);
      setSlider(slider, entry.value);
    }
    run.controls.handles.forEach(makeHandle);
  }

  function makeHandle(part) {
    const size = 0.035 * run.radius;
    const ball = new THREE.Mesh(
      new THREE.SphereGeometry(size, 32, 20),
      new THREE.MeshPhongMaterial({ color: 0x0072b2, opacity: 0.6, transparent: true, depthTest: false }));
    viewer.set_object(["setpoint", part], ball);
    handles[part] = viewer.scene_tree.find(["setpoint", part]).object;
    placeHandle(part);
  }

  // a handle is dragged in the plane through it that faces the camera
  const ray = new THREE.Raycaster(), plane = new THREE.Plane(), spot = new THREE.Vector3();
  let dragged = null;

  function aimAt(event) {
    const pane = viewer.renderer.domElement.getBoundingClientRect();
    ray.setFromCamera(new THREE.Vector2(2 * (event.clientX - pane.left) / pane.width - 1,
                                        1 - 2 * (event.clientY - pane.top) / pane.height), viewer.camera);
  }

  function beginDrag(event) {
    aimAt(event);
    const hit = ray.intersectObjects(Object.values(handles), true)[0];
    if (!hit) return;
    dragged = Object.keys(handles).find((part) => { let found = false;
      handles[part].traverse((object) => { found = found || object === hit.object; }); return found; });
    plane.setFromNormalAndCoplanarPoint(viewer.camera.getWorldDirection(new THREE.Vector3()),
                                        handles[dragged].getWorldPosition(new THREE.Vector3()));
    viewer.controls.enabled = false;
    event.preventDefault();
    event.stopPropagation();
  }

  function drag(event) {
    if (!dragged) return;
    aimAt(event);
    if (!ray.ray.intersectPlane(plane, spot)) return;
    const world = viewer.scene_tree.object.worldToLocal(spot.clone()).toArray();
    parts[dragged].slice(0, 3).forEach((slider, i) => setSlider(slider, world[i]));
    placeHandle(dragged);
    ask(dragged);
    event.stopPropagation();
  }

  function endDrag() {
    if (dragged) viewer.controls.enabled = true;
    dragged = null;
  }

  if (run.controls) {
    makeControls();
    const canvas = viewer.renderer.domElement;
    canvas.addEventListener("pointerdown", beginDrag, true);
    window.addEventListener("pointermove", drag, true);
    window.addEventListener("pointerup", endDrag, true);
  }

  function listen() {
    element("live").hidden = false;
    setFollowing(true);
    socket = new WebSocket((location.protocol === "https:" ? "wss://" : "ws://") + location.host + "/frames");
    socket.binaryType = "arraybuffer";
    socket.onmessage = (message) => {
      if (typeof message.data === "string") ended(); else take(new Float32Array(message.data));
    };
    socket.onclose = ended;
  }

  function ended() {
    element("live").hidden = true;
    element("controls").hidden = true;
    if (following && frames.length) show(frames[frames.length - 1][0]);
    setFollowing(false);
    api.ended = true;
  }

  element("title").textContent = run.title;
  if (run.notes.length) {
    element("notes").hidden = false;
    element("notes").querySelector("summary").textContent = run.notes.length + " note" + (run.notes.length > 1 ? "s" : "");
    for (const note of run.notes) {
      const item = document.createElement("li");
      item.textContent = note;
      element("notes").querySelector("ul").append(item);
    }
  }

  const api = window.phcontrol = {
    run, viewer, play, seek,
    pause: () => setPlaying(false),
    ended: false,
    get time() { return time; },
    get frames() { return frames.length; },
    /** Where a handle is on the page, in pixels: [x, y]. */
    handle(part) {
      const pane = viewer.renderer.domElement.getBoundingClientRect();
      viewer.camera.updateMatrixWorld(true);
      const at = handles[part].getWorldPosition(new THREE.Vector3()).project(viewer.camera);
      return [pane.left + (at.x + 1) * pane.width / 2, pane.top + (1 - at.y) * pane.height / 2];
    },
    get duration() { return frames.length ? frames[frames.length - 1][0] : 0; },
    /** Where a node of the scene is, in the world: [x, y, z]. */
    where(path) {
      const object = viewer.scene_tree.find(path.split("/")).object, root = viewer.scene_tree.object;
      root.updateMatrixWorld(true);
      return root.worldToLocal(object.getWorldPosition(new THREE.Vector3())).toArray();  // z up, not three.js's y
    },
  };

  lookAtScene();
  if (run.frames) take(decode(run.frames, Float32Array));
  if (run.live) listen(); else { show(0); play(); }
  window.requestAnimationFrame(tick);
})();
