// Plays runs in scenes side by side, with their signals over each other, under one time.
//
// Recorded frames are in the page; live ones come over a socket, and stay, so that a run can be played again when it
// has ended. A page that is live has one run.
"use strict";

const element = (id) => document.getElementById(id);

async function unpacked(id) {
  const bytes = Uint8Array.from(atob(element(id).textContent), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

async function begin() {
  if (element("meshcat")) {
    const script = document.createElement("script");
    script.textContent = await unpacked("meshcat");
    document.head.append(script);
  }
  startPlayer(JSON.parse(await unpacked("run")));
}

function startPlayer(runs) {
  const run = runs[0];  // what is of the page, not of a run, stands in the first
  const tracks = runs.map(makeTrack), known = () => tracks.every((track) => track.frames.length);
  let time = 0, playing = false, following = run.live, drawn = -1;

  const scheme = window.matchMedia("(prefers-color-scheme: dark)"), isDark = () => scheme.matches;
  element("meshcat-pane").dataset.runs = runs.length;
  const strongest = {}, scenes = tracks.map((track) => {
    const pane = document.createElement("div");
    pane.className = "pane";
    element("meshcat-pane").append(pane);
    const scene = makeScene(track.run, track.columns, pane, isDark, strongest);
    if (runs.length > 1) pane.append(nameOf(track));
    return scene;
  });
  if (runs.length > 1) lookAlike(scenes);
  const has = (group) => runs.some((each) => each.signals.some((signal) => signal.group === group));
  const first = ["storage function", "joint error", "torque"];
  if (has("contact")) first.splice(1, 1, "contact");
  if (!has(first[1])) first.splice(1, 1, "position");
  const charts = makeCharts(tracks, element("charts"), { seek, isDark, first });
  element("add").addEventListener("click", charts.add);
  const images = tracks.map((track) => {
    if (!track.run.image) return null;
    const canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "image plane of the camera" + (runs.length > 1 ? " of " + track.name : ""));
    element("images").append(canvas);
    return canvas;
  });

  function nameOf(track) {
    const name = document.createElement("div");
    name.className = "name";
    name.append(dashOf(track), track.name);
    return name;
  }

  // --- one moment -----------------------------------------------------------------------------------------

  function show(moment) {
    if (!known()) return;
    const start = Math.min(...tracks.map((track) => track.start)), end = Math.max(...tracks.map((track) => track.end));
    time = Math.min(Math.max(moment, start), end);
    tracks.forEach((track, k) => {
      track.goTo(time);
      scenes[k].show(track.frames, track.index, track.now);
    });
    if (!document.body.classList.contains("folded")) {
      charts.draw(time);
      tracks.forEach((track, k) => { if (images[k]) drawImage(track, images[k]); });
    }
    const units = runs.flatMap((each) => each.arrows.map((arrow) => arrow.unit));
    element("arrows").textContent = [...new Set(units)]
      .map((unit) => "arrows: 1 " + unit + " is " + readable(1000 * scenes[0].scaleOf(unit)) + " mm").join("; ");
    element("clock").textContent = time.toFixed(2) + " s of " + end.toFixed(2);
    const scrub = element("scrub");
    scrub.min = start;
    scrub.max = Math.max(end, start + 1e-6);
    scrub.value = time;
    scrub.setAttribute("aria-valuetext", time.toFixed(2) + " seconds");
    drawn = tracks[0].frames.length;
  }

  const startOfAll = () => Math.min(...tracks.map((track) => track.start));
  const endOfAll = () => (known() ? Math.max(...tracks.map((track) => track.end)) : 0);

  // --- playing --------------------------------------------------------------------------------------------

  let last = null;
  function tick(now) {
    if (following) {
      if (known() && tracks[0].frames.length !== drawn) show(endOfAll());
    } else if (playing && known()) {
      const passed = last === null ? 0 : (now - last) / 1000;
      show(time + passed * Number(element("speed").value));
      if (time >= endOfAll()) setPlaying(false);
    }
    last = now;
    window.requestAnimationFrame(tick);
  }

  function setPlaying(on) {
    playing = on;
    element("play").textContent = on ? "❚❚" : "▶";
    element("play").setAttribute("aria-label", on ? "pause" : "play");
  }

  function setFollowing(on) {
    following = on;
    element("live").classList.toggle("on", on);
  }

  function play() {
    setFollowing(false);
    if (known() && time >= endOfAll()) show(startOfAll());
    setPlaying(true);
  }

  function seek(moment) {
    setFollowing(false);
    setPlaying(false);
    show(moment);
  }

  function take(track, rows) {
    const { columns, frames } = track;
    for (let at = 0; at + columns.count <= rows.length; at += columns.count) {
      const frame = rows.subarray(at, at + columns.count);
      if (frames.length && frame[0] <= track.end) continue;
      frames.push(frame);
      scenes[track.number].noteForces(frame);
      charts.note(track, frame);
    }
  }

  // --- the page -------------------------------------------------------------------------------------------

  function fold(on) {
    document.body.classList.toggle("folded", on);
    element("fold").setAttribute("aria-expanded", String(!on));
    element("fold").textContent = on ? "show charts" : "hide charts";
    scenes.forEach((scene) => scene.fit());
    show(time);
  }

  let axes = true;
  function showAxes(on) {
    axes = on;
    element("axes").setAttribute("aria-pressed", String(on));
    scenes.forEach((scene) => scene.showFrames(on));
  }

  element("play").addEventListener("click", () => (playing ? setPlaying(false) : play()));
  element("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
  element("live").addEventListener("click", () => { setPlaying(false); setFollowing(true); drawn = -1; });
  element("fold").addEventListener("click", () => fold(!document.body.classList.contains("folded")));
  element("axes").addEventListener("click", () => showAxes(!axes));
  scheme.addEventListener("change", () => { scenes.forEach((scene) => scene.lookAtScene()); show(time); });
  new ResizeObserver(() => { scenes.forEach((scene) => scene.fit()); show(time); }).observe(element("meshcat-pane"));
  window.addEventListener("keydown", (event) => {
    const typing = ["INPUT", "SELECT", "BUTTON", "TEXTAREA"].includes(event.target.tagName);
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    const actions = {
      " ": () => (playing ? setPlaying(false) : play()),
      ArrowRight: () => seek(time + 0.1),
      ArrowLeft: () => seek(time - 0.1),
      Home: () => seek(startOfAll()),
      End: () => seek(endOfAll()),
      c: () => fold(!document.body.classList.contains("folded")),
      f: () => showAxes(!axes),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  });

  element("title").textContent = document.title;
  if (run.certificate) {
    element("badge").hidden = false;
    element("badge").classList.toggle("failed", !run.certificate.passed);
    element("badge").querySelector("summary").textContent = "certificate: " + run.certificate.verdict;
    element("badge").querySelector("pre").textContent = run.certificate.text;
  }
  const notes = tracks.flatMap((track) => track.run.notes.map((note) => (runs.length > 1 ? track.name + ": " : "") + note));
  if (notes.length) {
    element("notes").hidden = false;
    element("notes").querySelector("summary").textContent = notes.length + " note" + (notes.length > 1 ? "s" : "");
    for (const note of notes) {
      const item = document.createElement("li");
      item.textContent = note;
      element("notes").querySelector("ul").append(item);
    }
  }

  // --- live -----------------------------------------------------------------------------------------------

  let socket = null, handleAt = () => [0, 0];

  function listen() {
    element("live").hidden = false;
    setFollowing(true);
    socket = new WebSocket((location.protocol === "https:" ? "wss://" : "ws://") + location.host + "/frames");
    socket.binaryType = "arraybuffer";
    socket.onmessage = (message) => {
      if (typeof message.data === "string") ended(); else take(tracks[0], new Float32Array(message.data));
    };
    socket.onclose = ended;
  }

  function ended() {
    element("live").hidden = true;
    element("controls").hidden = true;
    if (following && known()) show(endOfAll());
    setFollowing(false);
    api.ended = true;
  }

  if (run.controls) {
    handleAt = makeControls(run, scenes[0], element("controls"), (part, values) => {
      if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ part, values }));
    });
  }

  const { viewer, THREE } = scenes[0];
  const api = window.phcontrol = {
    runs, viewer, charts, play, seek, fold,
    pause: () => setPlaying(false),
    ended: false,
    handle: (part) => handleAt(part),
    get time() { return time; },
    get frames() { return Math.min(...tracks.map((track) => track.frames.length)); },
    get duration() { return endOfAll(); },
    /** Where each scene is looked at from. */
    get cameras() { return scenes.map((scene) => scene.viewer.camera.position.toArray()); },
    /** Where a node of a run's scene is, in the world: [x, y, z]. */
    where(path, number = 0) {
      const tree = scenes[number].viewer.scene_tree, object = tree.find(path.split("/")).object, root = tree.object;
      root.updateMatrixWorld(true);
      return root.worldToLocal(object.getWorldPosition(new THREE.Vector3())).toArray();  // z up, not three.js's y
    },
  };

  const fitAll = () => scenes.forEach((scene) => scene.fit());
  window.requestAnimationFrame(() => window.requestAnimationFrame(fitAll));  // after MeshCat's own first fit
  scenes.forEach((scene) => scene.lookAtScene());
  for (const track of tracks) if (track.run.frames) take(track, framesOf(track.run.frames, track.columns.count));
  if (run.live) listen(); else { show(0); play(); }
  window.requestAnimationFrame(tick);
}

begin().catch((error) => {
  element("title").textContent = "this page needs a newer browser: " + error.message;
  throw error;
});
