// The scene: what stands in it, and where everything is in one frame.
"use strict";

function decode(text, kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new kind(bytes.buffer);
}

/** Whole numbers from their differences, as shapes.py writes them: column after column, in an array of some kind. */
function wholeNumbers(text, columns, kind = Uint16Array) {
  const bytes = decode(text, Uint8Array), width = kind.BYTES_PER_ELEMENT, count = bytes.length / width;
  const whole = new kind(count), rows = count / columns;
  for (let i = 0; i < count; i++) {
    let coded = 0;
    for (let plane = 0; plane < width; plane++) coded |= bytes[plane * count + i] << (8 * plane);
    whole[i] = (i % rows ? whole[i - 1] : 0) + ((coded >>> 1) ^ -(coded & 1));  // modulo 2¹⁶ or 2³², as the array is
  }
  return whole;
}

/** Recorded frames, one after another, from their columns. */
function framesOf(text, columns) {
  const table = new Float32Array(wholeNumbers(text, columns, Uint32Array).buffer), rows = table.length / columns;
  return Float32Array.from(table, (_, i) => table[(i % columns) * rows + Math.floor(i / columns)]);
}

/** Lets scenes side by side be looked at from one place: what is turned in one turns in all. */
function lookAlike(scenes) {
  let busy = false;
  for (const { viewer } of scenes) viewer.controls.addEventListener("change", () => {
    if (busy) return;
    busy = true;
    for (const other of scenes) if (other.viewer !== viewer) {
      other.viewer.camera.position.copy(viewer.camera.position);
      other.viewer.controls.target.copy(viewer.controls.target);
      other.viewer.controls.update();
      other.viewer.set_dirty();
    }
    busy = false;
  });
}

/** Makes the scene of a run; columns says where in a frame what begins, strongest, common to all scenes, the longest arrows. */
function makeScene(run, columns, pane, isDark, strongest) {
  const viewer = new MeshCat.Viewer(pane), THREE = MeshCat.THREE;

  function pointsOf(shape) {
    const whole = wholeNumbers(shape.points, 3), rows = whole.length / 3, points = new Float32Array(whole.length);
    for (let i = 0; i < whole.length; i++) {
      const row = Math.floor(i / 3), axis = i % 3;
      points[i] = shape.low[axis] + whole[axis * rows + row] * shape.step[axis];
    }
    return points;
  }

  function geometryOf(shape) {
    if (shape.kind === "box") return new THREE.BoxGeometry(...shape.size);
    if (shape.kind === "sphere") return new THREE.SphereGeometry(shape.size[0], 32, 20);
    if (shape.kind === "cylinder") {  // along y in three.js, along z in a URDF
      return new THREE.CylinderGeometry(shape.size[0], shape.size[0], shape.size[1], 36).rotateX(Math.PI / 2);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(pointsOf(shape), 3));
    if (shape.kind === "mesh") {
      geometry.setIndex(new THREE.BufferAttribute(
        shape.wide ? decode(shape.faces, Uint32Array) : wholeNumbers(shape.faces, 1), 1));
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
      const kind = shape.kind === "lines" ? THREE.LineSegments : THREE.Mesh;
      const object = new kind(geometries[entry.shape], materialOf(entry.color, shape.kind));
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

  /** Notes how long the arrows of a frame are: the longest of all frames has half the scene's radius. */
  function noteForces(frame) {
    run.arrows.forEach((arrow, i) => {
      const at = columns.arrows + 6 * i + 3;
      const size = Math.hypot(frame[at], frame[at + 1], frame[at + 2]);
      strongest[arrow.unit] = Math.max(strongest[arrow.unit] || 0, size);
    });
  }

  /** Metres a newton: one, two or five times a power of ten. */
  function scaleOf(unit) {
    const desired = 0.5 * run.radius / (strongest[unit] || 1);
    const power = Math.pow(10, Math.floor(Math.log10(desired)));
    return power * (desired >= 5 * power ? 5 : desired >= 2 * power ? 2 : 1);
  }

  const up = new THREE.Vector3(0, 1, 0), along = new THREE.Vector3();
  function drawArrows(frame) {
    arrows.forEach((parts, i) => {
      const at = columns.arrows + 6 * i, size = Math.hypot(frame[at + 3], frame[at + 4], frame[at + 5]);
      const length = size * scaleOf(run.arrows[i].unit);
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

  function drawTrail(frames, index, frame) {
    const step = Math.ceil((frames.length + 1) / (TRAIL - 1)), places = trail.attributes.position, at = columns.trail;
    let count = 0;
    for (let i = 0; i <= index; i += step) {
      const row = frames[i];
      places.setXYZ(count++, row[at], row[at + 1], row[at + 2]);
    }
    places.setXYZ(count++, frame[at], frame[at + 1], frame[at + 2]);
    places.needsUpdate = true;
    trail.setDrawRange(0, count);
  }

  /** Colours by the scheme, a floor below the arm, and its camera where it sees all of the motion. */
  function lookAtScene() {
    const dark = isDark();
    viewer.set_property(["Background"], "top_color", dark ? [0.13, 0.14, 0.17] : [0.96, 0.97, 0.98]);
    viewer.set_property(["Background"], "bottom_color", dark ? [0.06, 0.07, 0.09] : [0.80, 0.83, 0.87]);
    const radius = run.radius, [x, y, z] = run.center;
    const grid = new THREE.GridHelper(8 * radius, 32, dark ? 0x59606b : 0x9aa0a8, dark ? 0x343a44 : 0xc3c7cd);
    grid.rotateX(Math.PI / 2);
    grid.position.set(0, 0, run.floor);
    viewer.set_object(["Grid"], grid);
    viewer.set_object(["Axes"], new THREE.AxesHelper(0.25 * radius));
    viewer.camera.fov = 40;
    viewer.camera.near = radius / 100;
    fit();
    // the camera lives in axes whose y points up: (x, y, z) of the world is (x, z, −y) there
    const half = 0.5 * viewer.camera.fov * Math.PI / 180;
    const away = 1.08 * radius / Math.sin(Math.min(half, Math.atan(Math.tan(half) * viewer.camera.aspect)));
    viewer.controls.target.set(x, z, -y);
    viewer.camera.position.set(x, z, -y).addScaledVector(new THREE.Vector3(0.80, 0.38, 0.55).normalize(), away);
    viewer.controls.update();
  }

  /** Fits the picture into its pane. */
  function fit() {
    viewer.set_3d_pane_size(Math.max(1, pane.clientWidth), Math.max(1, pane.clientHeight));
  }

  function show(frames, index, frame) {
    nodes.forEach((object, n) => place(object, frame.subarray(columns.nodes + 7 * n, columns.nodes + 7 * n + 7)));
    drawArrows(frame);
    drawTrail(frames, index, frame);
    viewer.set_dirty();
  }

  function showFrames(on) {
    const object = viewer.scene_tree.find(["frames"]).object;
    object.visible = on;
    viewer.set_dirty();
  }

  return { viewer, THREE, show, noteForces, scaleOf, lookAtScene, fit, showFrames };
}
