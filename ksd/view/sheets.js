// A mechanism in three dimensions, and its drawing in a plane: one component for the live page, reports and notebooks.
// `Sheets` draws into an element and knows no page; the default export makes it a component of the live page.
import { CSS2DObject, CSS2DRenderer, OrbitControls, THREE } from "nicegui-scene";

const GREY = new THREE.Color("#b6bcc6");

function floats(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

export class Sheets {
  constructor(element) {
    this.element = element;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color("#ffffff");
    this.scene.add(new THREE.HemisphereLight("#ffffff", "#8d96a5", 2.2));
    this.lamp = new THREE.DirectionalLight("#ffffff", 1.6);
    this.camera = new THREE.OrthographicCamera(-1, 1, 1, -1, -10, 10);
    this.camera.up.set(0, 0, 1);
    this.renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(window.devicePixelRatio);
    this.names = new CSS2DRenderer();
    this.names.domElement.style.cssText = "position:absolute;inset:0;pointer-events:none;overflow:hidden";
    element.append(this.renderer.domElement, this.names.domElement);
    this.scale = document.createElement("div");
    this.scale.className = "ksd-scale";
    element.append(this.scale);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.later());
    this.scene.add(this.camera);
    this.camera.add(this.lamp);
    this.parts = new THREE.Group();
    this.scene.add(this.parts);
    this.resized = new ResizeObserver(() => this.resize());
    this.resized.observe(element);
    this.resize();
  }

  // everything that stays as long as the model does
  setGeometry(given) {
    this.release();
    this.given = given;
    const [low, high] = given.bounds.map((p) => new THREE.Vector3(...p));
    this.size = Math.max(low.distanceTo(high), 1e-6);
    this.middle = low.clone().add(high).multiplyScalar(0.5);
    const rest = floats(given.rest);
    this.addOutline(rest);
    this.addSheets(rest);
    this.bodies = given.bodies.map((body) => this.addBody(body));
    this.marks = given.marks.map((mark) => this.addMark(mark));
    const looked = `${given.plane}`;
    if (this.looked !== looked) this.lookAt(given.plane);
    this.looked = looked;
    this.later();
  }

  addSheets(rest) {
    const index = [];
    let first = 0;
    this.station = []; // station of every corner, for its colour
    let station = 0;
    for (const leaf of this.given.leaves) {
      const n = leaf.corners;
      for (let k = 0; k < leaf.stations; k++) {
        for (let c = 0; c < n; c++) {
          this.station.push(station);
          if (k + 1 === leaf.stations) continue;
          const a = first + k * n + c;
          const b = first + k * n + ((c + 1) % n);
          index.push(a, b, a + n, b, b + n, a + n);
        }
        station++;
      }
      for (const end of [first, first + (leaf.stations - 1) * n])
        for (let c = 2; c < n; c++) index.push(end, end + c - 1, end + c);
      first += leaf.stations * n;
    }
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(rest.slice(), 3));
    shape.setAttribute("color", new THREE.BufferAttribute(new Float32Array(rest.length), 3));
    shape.setIndex(index);
    const material = new THREE.MeshStandardMaterial({
      vertexColors: true, side: THREE.DoubleSide, flatShading: true, roughness: 0.75,
    });
    this.sheets = new THREE.Mesh(shape, material);
    this.sheets.frustumCulled = false;
    this.parts.add(this.sheets);
    this.paint(null);
  }

  addOutline(rest) {
    const lines = [];
    let first = 0;
    const corner = (k) => rest.slice(3 * k, 3 * k + 3);
    for (const leaf of this.given.leaves) {
      const n = leaf.corners;
      for (const c of [0, n / 2])
        for (let k = 0; k + 1 < leaf.stations; k++)
          lines.push(...corner(first + k * n + c), ...corner(first + (k + 1) * n + c));
      first += n * leaf.stations;
    }
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(new Float32Array(lines), 3));
    this.parts.add(new THREE.LineSegments(shape, new THREE.LineBasicMaterial({ color: "#b9c0cc" })));
  }

  addBody(body) {
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(floats(body.corners), 3));
    const material = new THREE.MeshStandardMaterial({ color: body.color, flatShading: true, roughness: 0.8 });
    const mesh = new THREE.Mesh(shape, material);
    mesh.matrixAutoUpdate = false;
    mesh.userData.color = new THREE.Color(body.color);
    if (body.name) mesh.add(this.label(body.name, "#4b5563", new THREE.Vector3(...body.at)));
    this.parts.add(mesh);
    return mesh;
  }

  label(text, color, at) {
    const element = document.createElement("div");
    element.textContent = text;
    element.className = "ksd-name";
    element.style.color = color;
    const label = new CSS2DObject(element);
    if (at) label.position.copy(at);
    return label;
  }

  // of unit size along x; scaled and turned with the pose
  addMark(mark) {
    const material = new THREE.MeshStandardMaterial({ color: mark.color, roughness: 0.7, depthTest: false });
    const group = new THREE.Group();
    const add = (shape, place, turn) => {
      const mesh = new THREE.Mesh(shape, material);
      mesh.position.set(...place);
      if (turn) mesh.rotation.set(...turn);
      mesh.renderOrder = 1; // seen through bodies
      group.add(mesh);
    };
    const across = [0, 0, -Math.PI / 2];
    if (mark.figure === "arrow") {
      add(new THREE.CylinderGeometry(0.02, 0.02, 0.75, 10), [0.375, 0, 0], across);
      add(new THREE.ConeGeometry(0.07, 0.25, 16), [0.875, 0, 0], across);
    } else if (mark.figure === "turn") {
      add(new THREE.TorusGeometry(0.35, 0.02, 8, 40, 1.5 * Math.PI), [0, 0, 0], [0, Math.PI / 2, 0]);
      add(new THREE.CylinderGeometry(0.012, 0.012, 0.8, 8), [0, 0, 0], across);
      add(new THREE.ConeGeometry(0.05, 0.2, 12), [0.5, 0, 0], across);
    } else if (mark.figure === "pin") {
      add(new THREE.CylinderGeometry(0.45, 0.45, 1.6, 24), [0, 0, 0], across);
    } else if (mark.figure === "box") {
      add(new THREE.BoxGeometry(2, 0.8, 0.8), [0, 0, 0]);
    } else if (mark.figure === "ball") {
      add(new THREE.SphereGeometry(0.7, 20, 14), [0, 0, 0]);
    } else {
      const points = [];
      const coils = mark.figure === "coil" ? 48 : 1;
      for (let k = 0; k <= coils; k++) {
        const s = k / coils;
        const bend = coils > 1 && s > 0.15 && s < 0.85 ? 0.04 : 0;
        points.push(new THREE.Vector3(s, bend * Math.cos(1.5 * k), bend * Math.sin(1.5 * k)));
      }
      const shape = new THREE.BufferGeometry().setFromPoints(points);
      group.add(new THREE.Line(shape, new THREE.LineBasicMaterial({ color: mark.color })));
    }
    if (mark.name) group.add(this.label(mark.name, mark.color, new THREE.Vector3(mark.figure === "arrow" ? 1.1 : 0.6, 0, 0)));
    this.parts.add(group);
    return group;
  }

  // a pose: corners of sheets, frames of bodies, marks, stress
  setPose(pose, refused = false) {
    if (!this.given) return;
    const place = this.sheets.geometry.attributes.position;
    const sent = floats(pose.sheets);
    if (sent.length !== place.array.length) return;
    place.array.set(sent);
    place.needsUpdate = true;
    const frames = floats(pose.frames);
    this.bodies.forEach((body, k) => {
      body.matrix.set(...frames.subarray(12 * k, 12 * k + 12), 0, 0, 0, 1);
      body.matrixWorldNeedsUpdate = true;
    });
    const marks = floats(pose.marks);
    const x = new THREE.Vector3(1, 0, 0);
    this.marks.forEach((mark, k) => {
      const vector = new THREE.Vector3(...marks.subarray(6 * k + 3, 6 * k + 6));
      const long = vector.length();
      mark.visible = long > 1e-9 * this.size;
      mark.position.set(...marks.subarray(6 * k, 6 * k + 3));
      if (!mark.visible) return;
      mark.quaternion.setFromUnitVectors(x, vector.divideScalar(long));
      mark.scale.setScalar(long);
    });
    this.setRefused(refused);
    if (!refused) this.paint(pose.stress ? floats(pose.stress) : null, pose.most);
    this.later();
  }

  // poses one after another, again and again; `seconds` for all of them
  play(poses, seconds) {
    this.stop();
    if (!this.given || !poses.length) return;
    const began = performance.now();
    let shown = -1;
    const step = (now) => {
      const k = Math.floor((((now - began) / 1000 / seconds) % 1) * poses.length);
      if (k !== shown) {
        this.setPose(poses[Math.max(k, 0)]);
        window.ksdPlayed = (window.ksdPlayed || 0) + 1;
      }
      shown = k;
      this.playing = requestAnimationFrame(step);
    };
    this.playing = requestAnimationFrame(step);
  }

  stop() {
    if (this.playing) cancelAnimationFrame(this.playing);
    this.playing = 0;
  }

  setRefused(refused) {
    if (!this.given) return;
    for (const body of this.bodies) body.material.color.copy(refused ? GREY : body.userData.color);
    if (refused) this.paint("grey");
    this.later();
  }

  paint(stress, most = "") {
    if (!this.given) return;
    const color = this.sheets.geometry.attributes.color;
    const plain = stress === "grey" ? GREY : new THREE.Color(this.given.leafColor);
    const ramp = this.given.colors;
    for (let k = 0; k < this.station.length; k++) {
      if (stress === null || stress === "grey") color.setXYZ(k, plain.r, plain.g, plain.b);
      else {
        const at = Math.min(ramp.length - 1, Math.max(0, Math.round(stress[this.station[k]] * (ramp.length - 1))));
        const c = ramp[at];
        color.setXYZ(k, c[0] ** 2.2, c[1] ** 2.2, c[2] ** 2.2);
      }
    }
    color.needsUpdate = true;
    const shown = Array.isArray(stress) || stress instanceof Float32Array;
    this.scale.style.display = shown ? "" : "none";
    if (!shown) return;
    if (!this.scale.firstChild) {
      const stops = ramp.map((c) => `rgb(${c.map((v) => Math.round(255 * v)).join(",")})`);
      this.scale.innerHTML = "<span>0</span><i></i><span></span>";
      this.scale.children[1].style.background = `linear-gradient(to right, ${stops.join(",")})`;
    }
    this.scale.lastChild.textContent = `${most} MPa`;
  }

  lookAt(plane) {
    const from = { xy: [0, 0, 1], xz: [0, -1, 0], yz: [1, 0, 0] }[plane] || [0.75, -1.3, 0.8];
    this.camera.up.set(...(plane === "xy" ? [0, 1, 0] : [0, 0, 1]));
    this.camera.position.copy(this.middle).addScaledVector(new THREE.Vector3(...from).normalize(), 4 * this.size);
    this.controls.target.copy(this.middle);
    // what is seen of the box around it, with room for arrows and names
    this.camera.lookAt(this.middle);
    this.camera.updateMatrixWorld();
    const [low, high] = this.given.bounds;
    let wide = 0;
    let tall = 0;
    for (let k = 0; k < 8; k++) {
      const corner = new THREE.Vector3(...[0, 1, 2].map((i) => ((k >> i) & 1 ? high : low)[i]));
      corner.applyMatrix4(this.camera.matrixWorldInverse);
      wide = Math.max(wide, Math.abs(corner.x));
      tall = Math.max(tall, Math.abs(corner.y));
    }
    this.extent = [1.15 * wide + 0.02 * this.size, 1.15 * tall + 0.02 * this.size];
    this.camera.near = -10 * this.size;
    this.camera.far = 20 * this.size;
    this.lamp.position.set(0.3 * this.size, 0.6 * this.size, this.size);
    this.controls.update();
    this.resize();
  }

  resize() {
    const { clientWidth: wide, clientHeight: tall } = this.element;
    if (!wide || !tall) return;
    this.renderer.setSize(wide, tall);
    this.names.setSize(wide, tall);
    const [x, y] = this.extent || [1, 1];
    const half = Math.max(x / wide, y / tall);
    Object.assign(this.camera, { left: -half * wide, right: half * wide, top: half * tall, bottom: -half * tall });
    this.camera.updateProjectionMatrix();
    this.later();
  }

  later() {
    if (this.asked) return;
    this.asked = requestAnimationFrame(() => {
      this.asked = 0;
      this.renderer.render(this.scene, this.camera);
      this.names.render(this.scene, this.camera);
      const drawn = this.afterDrawn;
      this.afterDrawn = null;
      if (drawn) drawn();
    });
  }

  picture() {
    this.renderer.render(this.scene, this.camera);
    return this.renderer.domElement.toDataURL("image/png");
  }

  release() {
    for (const part of [...this.parts.children]) {
      part.traverse((one) => {
        one.geometry?.dispose();
        one.material?.dispose();
        one.element?.remove();
      });
      this.parts.remove(part);
    }
  }

  end() {
    this.stop();
    this.resized.disconnect();
    cancelAnimationFrame(this.asked);
    if (this.given) this.release();
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.element.replaceChildren();
  }
}

export default {
  template: `
    <div class="ksd-view" style="position:relative;width:100%;height:100%;overflow:hidden">
      <div v-show="mode === 'space'" ref="space" style="position:absolute;inset:0"></div>
      <svg v-show="mode === 'plane'" ref="plane" style="position:absolute;inset:0;width:100%;height:100%;touch-action:none"
        tabindex="0" preserveAspectRatio="xMidYMid meet"></svg>
      <div v-if="failed" class="ksd-failed">{{ failed }}</div>
    </div>`,
  props: { mode: String },
  data: () => ({ failed: "" }),
  mounted() {
    window.ksdUpdates ??= 0;
    try {
      this.sheets = new Sheets(this.$refs.space);
    } catch (reason) {
      this.failed = "This browser shows no three dimensions (WebGL is off); the plane view and all numbers work.";
    }
    const svg = this.$refs.plane;
    for (const kind of ["pointerdown", "pointermove", "pointerup", "dblclick"])
      svg.addEventListener(kind, (event) => this.pointer(kind, event));
    svg.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.$emit("zoom", { ...this.where(event), by: event.deltaY });
    }, { passive: false });
    this.$emit("ready");
  },
  beforeUnmount() {
    this.sheets?.end();
  },
  methods: {
    // one update; the answer that it has been drawn lets the next one come
    update(sent) {
      if (sent.pose || sent.geometry) this.sheets?.stop();
      if (sent.geometry) this.sheets?.setGeometry(sent.geometry);
      if (sent.pose) this.sheets?.setPose(sent.pose, sent.refused);
      else if (sent.refused) this.sheets?.setRefused(true);
      if (sent.svg !== undefined) this.drawPlane(sent.svg, sent.box);
      const done = () => {
        if (sent.number !== this.lastNumber) window.ksdUpdates += 1;
        this.lastNumber = sent.number;
        this.$emit("drawn", sent.number);
        this.inFlight = false;
        if (this.waiting) this.send(...this.waiting);
      };
      if (this.sheets && this.mode === "space") {
        this.sheets.afterDrawn = done;
        this.sheets.later();
      } else done();
    },
    play(poses, seconds) {
      this.sheets?.play(poses, seconds);
    },
    colour(pose) {
      if (this.sheets?.playing) return;
      this.sheets?.paint(floats(pose.stress), pose.most);
      this.sheets?.later();
    },
    drawPlane(svg, box) {
      const element = this.$refs.plane;
      if (box) element.setAttribute("viewBox", box.join(" "));
      element.innerHTML = svg;
    },
    where(event) {
      const svg = this.$refs.plane;
      const to = svg.getScreenCTM();
      if (!to) return { x: 0, y: 0 };
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(to.inverse());
      return { x: at.x, y: at.y, name: event.target?.dataset?.name || "" };
    },
    // moves are sent one at a time, the newest when the answer to the last is there
    pointer(kind, event) {
      if (kind === "pointerdown") {
        this.$refs.plane.setPointerCapture(event.pointerId);
        this.$refs.plane.focus();
      }
      const args = { ...this.where(event), kind, shift: event.shiftKey, held: event.buttons > 0 };
      if (kind === "pointermove" && (this.inFlight || !args.held)) {
        this.waiting = args.held ? [args] : null;
        if (args.held || !this.follows) return;
      }
      this.waiting = null;
      this.send(args);
    },
    send(args) {
      this.waiting = null;
      this.inFlight = args.kind === "pointermove";
      this.$emit("pointer", args);
    },
    follow(on) {
      this.follows = on;
    },
    picture() {
      if (this.mode === "plane") return new XMLSerializer().serializeToString(this.$refs.plane);
      return this.sheets?.picture() || "";
    },
    lookAt(plane) {
      this.sheets?.lookAt(plane);
    },
  },
};
