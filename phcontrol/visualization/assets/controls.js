// What may be changed while a run goes on: sliders, and balls in the scene that are dragged.
"use strict";

/** Fills the form; send(part, values) is called with what the user asks for. Returns where handles are on the page. */
function makeControls(run, scene, form, send) {
  const { viewer, THREE } = scene, handles = {}, parts = {};  // sliders by the part of the setpoint that they are of

  function ask(part) { send(part, parts[part].map((slider) => Number(slider.input.value))); }

  function setSlider(slider, value) {
    slider.input.value = Math.min(slider.high, Math.max(slider.low, value));
    slider.output.textContent = readable(Number(slider.input.value)) + " " + slider.unit;
  }

  function placeHandle(part) {  // where the hand is asked to be
    if (handles[part]) handles[part].position.set(...parts[part].slice(0, 3).map((slider) => Number(slider.input.value)));
    viewer.set_dirty();
  }

  function makeHandle(part) {
    const ball = new THREE.Mesh(
      new THREE.SphereGeometry(0.035 * run.radius, 32, 20),
      new THREE.MeshPhongMaterial({ color: 0x0072b2, opacity: 0.6, transparent: true, depthTest: false }));
    viewer.set_object(["setpoint", part], ball);
    handles[part] = viewer.scene_tree.find(["setpoint", part]).object;
    placeHandle(part);
  }

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
    slider.input.addEventListener("input", () => {
      setSlider(slider, Number(slider.input.value));
      placeHandle(entry.part);
      ask(entry.part);
    });
    label.append(name, slider.input, slider.output);
    form.append(label);
    parts[entry.part].push(slider);
    setSlider(slider, entry.value);
  }
  run.controls.handles.forEach(makeHandle);

  // a handle is dragged in the plane through it that faces the camera
  const ray = new THREE.Raycaster(), plane = new THREE.Plane(), spot = new THREE.Vector3();
  let dragged = null;

  function aimAt(event) {
    const pane = viewer.renderer.domElement.getBoundingClientRect();
    ray.setFromCamera(new THREE.Vector2(2 * (event.clientX - pane.left) / pane.width - 1,
                                        1 - 2 * (event.clientY - pane.top) / pane.height), viewer.camera);
  }

  viewer.renderer.domElement.addEventListener("pointerdown", (event) => {
    aimAt(event);
    const hit = ray.intersectObjects(Object.values(handles), true)[0];
    if (!hit) return;
    dragged = Object.keys(handles).find((part) => {
      let found = false;
      handles[part].traverse((object) => { found = found || object === hit.object; });
      return found;
    });
    plane.setFromNormalAndCoplanarPoint(viewer.camera.getWorldDirection(new THREE.Vector3()),
                                        handles[dragged].getWorldPosition(new THREE.Vector3()));
    viewer.controls.enabled = false;
    event.preventDefault();
    event.stopPropagation();
  }, true);
  window.addEventListener("pointermove", (event) => {
    if (!dragged) return;
    aimAt(event);
    if (!ray.ray.intersectPlane(plane, spot)) return;
    const world = viewer.scene_tree.object.worldToLocal(spot.clone()).toArray();
    parts[dragged].slice(0, 3).forEach((slider, i) => setSlider(slider, world[i]));
    placeHandle(dragged);
    ask(dragged);
    event.stopPropagation();
  }, true);
  window.addEventListener("pointerup", () => {
    if (dragged) viewer.controls.enabled = true;
    dragged = null;
  }, true);

  /** Where a handle is on the page, in pixels: [x, y]. */
  return function handleAt(part) {
    const pane = viewer.renderer.domElement.getBoundingClientRect();
    viewer.camera.updateMatrixWorld(true);
    const at = handles[part].getWorldPosition(new THREE.Vector3()).project(viewer.camera);
    return [pane.left + (at.x + 1) * pane.width / 2, pane.top + (1 - at.y) * pane.height / 2];
  };
}
