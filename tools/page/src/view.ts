// Both views on one canvas: the skin as it unfolds, and its map, from the same buffers.

import {
  BufferAttribute, BufferGeometry, Color, DoubleSide, GLSL3, LineSegments, Matrix4, Mesh, OrthographicCamera, Points, Quaternion,
  RawShaderMaterial, Scene, Vector3, Vector4, WebGLRenderer, WebGLRenderTarget,
} from 'three';
import type { Patch } from './patch';

const VERTEX = `precision highp float;
in vec3 p0; in vec3 p1; in vec3 p2; in vec3 p3; in vec2 sheet; in vec4 colour;
uniform float shares[5]; uniform mat4 fold; uniform mat4 flatPose; uniform mat4 viewMatrix; uniform mat4 projectionMatrix;
uniform float dot_px; uniform float nearer;
out vec3 at; out vec4 tint; out vec2 onSheet;
void main() {
  vec3 p = shares[0] * p0 + shares[1] * p1 + shares[2] * p2 + shares[3] * p3 + shares[4] * (flatPose * vec4(sheet, 0.0, 1.0)).xyz;
  vec4 seen = viewMatrix * fold * vec4(p, 1.0);
  at = seen.xyz; tint = colour; onSheet = sheet;
  gl_Position = projectionMatrix * seen;
  gl_Position.z -= nearer;
  gl_PointSize = dot_px;
}`;
const FACES = `precision highp float;
in vec3 at; in vec4 tint; uniform float lit; uniform vec3 accent; out vec4 pixel;
void main() {
  vec3 n = normalize(cross(dFdx(at), dFdy(at)));
  float side = gl_FrontFacing ? 1.0 : 0.72;
  if (n.z < 0.0) n = -n;
  float light = side * (0.66 + 0.34 * max(0.0, dot(n, normalize(vec3(-0.35, 0.45, 0.85)))));
  vec3 rgb = mix(tint.rgb, accent, 0.85 * tint.a);
  pixel = vec4(rgb * mix(1.0, light, lit), 1.0);
}`;
const INK = `precision highp float;
in vec4 tint; uniform vec4 ink; uniform float round_dots; out vec4 pixel;
void main() {
  if (round_dots > 0.5 && length(gl_PointCoord - 0.5) > 0.5) discard;
  pixel = ink;
}`;
const PLACE = `precision highp float;
in vec2 onSheet; uniform vec2 sheetSize; out vec4 pixel;
void main() {
  vec2 x = floor(clamp(onSheet / sheetSize, 0.0, 1.0) * 65534.0 + 0.5);
  vec2 high = floor(x / 256.0);
  vec2 low = x - 256.0 * high;
  pixel = vec4(high.x, low.x, high.y, low.y) / 255.0;
}`;

interface Drawn { faces: Mesh; mesh: LineSegments; fields: LineSegments[]; dots: Points; colours: BufferAttribute; visible: boolean }
export interface Rect { x: number; y: number; width: number; height: number }
export interface Theme { background: string; ink: [number, number, number]; accent: string }

/** The camera of either view: orthographic, so that lengths are true. */
export interface Eye { azimuth: number; elevation: number; x: number; y: number; zoom: number }

const smooth = (x: number): number => { const t = Math.min(1, Math.max(0, x)); return t * t * (3 - 2 * t); };

export class View {
  readonly skinEye: Eye = { azimuth: -1.1, elevation: 0.45, x: 0, y: 0, zoom: 1 };
  readonly mapEye: Eye = { azimuth: 0, elevation: 0, x: 0, y: 0, zoom: 1 };
  skin: Rect = { x: 0, y: 0, width: 1, height: 1 };
  map: Rect = { x: 0, y: 0, width: 1, height: 1 };
  unfold = 0;
  level = 0;
  hasLines = true;
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly drawn: Drawn[] = [];
  private readonly camera = new OrthographicCamera();
  private readonly materials: RawShaderMaterial[] = [];
  private readonly place: RawShaderMaterial;
  private readonly folds: { fold: Matrix4; flatPose: Matrix4 }[];
  private readonly centre = new Vector3();
  private readonly radius: number;
  /** Half of the width and of the height that the skin takes when it is first seen. */
  private readonly extent: [number, number] = [0, 0];
  /** How far apart patches fly, toward the viewer, who does not see it. */
  private readonly storey: number;
  /** How deep the views are, in m. */
  private readonly reach: number;
  private readonly stands = { shares: { value: [1, 0, 0, 0, 0] }, lit: { value: 1 }, sheetSize: { value: [1, 1] } };
  private ids: { target: WebGLRenderTarget; pixels: Uint8Array } | null = null;
  private theme: Theme = { background: '#fff', ink: [0, 0, 0], accent: '#d03060' };

  constructor(readonly canvas: HTMLCanvasElement, readonly patches: Patch[], readonly sheet: [number, number]) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: false });
    this.renderer.autoClear = false;
    const lo = new Vector3(Infinity, Infinity, Infinity), hi = lo.clone().negate(), at = new Vector3();
    for (const p of patches) for (let k = 0; k < p.places; k++) {
      at.fromArray(p.keys[0], 3 * k).applyMatrix4(p.pose);
      lo.min(at); hi.max(at);
    }
    this.centre.copy(lo).add(hi).multiplyScalar(0.5);
    this.radius = Math.max(hi.distanceTo(lo) / 2, 1e-6);
    this.storey = Math.hypot(...sheet);
    this.reach = 8 * this.radius + this.storey * (1 + patches.length);
    this.stands.sheetSize.value = sheet;
    this.folds = patches.map(() => ({ fold: new Matrix4(), flatPose: new Matrix4() }));
    patches.forEach((patch, k) => this.drawn.push(this.add(patch, k)));
    this.place = this.material(PLACE, {});
    const outward = new Vector3();
    for (const p of patches) for (let f = 0; f < p.faces; f += Math.max(1, p.faces >> 9)) {
      const [a, b, c] = [0, 1, 2].map((i) => new Vector3().fromArray(p.keys[0], 3 * p.triangles[3 * f + i]).applyMatrix4(p.pose));
      outward.add(b.sub(a).cross(c.sub(a)));
    }
    // From outside, leaning to the front right and above, as `plot` looks.
    const toward = outward.normalize().add(new Vector3(0.4, -0.87, 0.3).normalize().multiplyScalar(0.85));
    this.home = { azimuth: Math.atan2(toward.y, toward.x), elevation: Math.atan2(toward.z, Math.hypot(toward.x, toward.y)), x: 0, y: 0, zoom: 1 };
    Object.assign(this.skinEye, this.home);
    const axes = this.axes(this.home);
    const most = [-Infinity, -Infinity], least = [Infinity, Infinity];
    for (const p of patches) for (let k = 0; k < p.places; k += 3) {
      at.fromArray(p.keys[0], 3 * k).applyMatrix4(p.pose).sub(this.centre);
      [0, 1].forEach((a) => { const x = at.dot(axes[a]); most[a] = Math.max(most[a], x); least[a] = Math.min(least[a], x); });
    }
    [0, 1].forEach((a) => { this.extent[a] = Math.max((most[a] - least[a]) / 2, 1e-6); });
    this.centre.addScaledVector(axes[0], (most[0] + least[0]) / 2).addScaledVector(axes[1], (most[1] + least[1]) / 2);
  }

  private readonly home: Eye;

  private material(fragmentShader: string, uniforms: Record<string, { value: unknown }>): RawShaderMaterial {
    const material = new RawShaderMaterial({
      vertexShader: VERTEX, fragmentShader, glslVersion: GLSL3, side: DoubleSide,
      uniforms: { ...this.stands, fold: { value: new Matrix4() }, flatPose: { value: new Matrix4() }, dot_px: { value: 1 }, nearer: { value: 0 }, round_dots: { value: 0 }, accent: { value: new Color() }, ink: { value: new Vector4() }, ...uniforms },
    });
    this.materials.push(material);
    return material;
  }

  private add(patch: Patch, index: number): Drawn {
    const attributes: Record<string, BufferAttribute> = {
      position: new BufferAttribute(patch.keys[0], 3), p0: new BufferAttribute(patch.keys[0], 3), p1: new BufferAttribute(patch.keys[1], 3),
      p2: new BufferAttribute(patch.keys[2], 3), p3: new BufferAttribute(patch.keys[3], 3), sheet: new BufferAttribute(patch.sheet, 2),
      colour: new BufferAttribute(new Uint8Array(4 * patch.places).fill(255), 4, true),
    };
    attributes.position = attributes.p0;
    for (let k = 0; k < patch.places; k++) attributes.colour.array[4 * k + 3] = 0;
    const geometry = (indices: Uint32Array | null): BufferGeometry => {
      const made = new BufferGeometry();
      for (const [name, attribute] of Object.entries(attributes)) made.setAttribute(name, attribute);
      if (indices) made.setIndex(new BufferAttribute(indices, 1));
      return made;
    };
    const fold = this.folds[index];
    const shared = { fold: { value: fold.fold }, flatPose: { value: fold.flatPose } };
    const faces = new Mesh(geometry(patch.triangles), this.material(FACES, shared));
    const mesh = new LineSegments(geometry(patch.edges), this.material(INK, { ...shared, nearer: { value: 0 } }));
    const fields = patch.fields.map((level) => new LineSegments(geometry(level.edges), this.material(INK, { ...shared, nearer: { value: 0 } })));
    const dots = new Points(geometry(null), this.material(INK, { ...shared, nearer: { value: 0 }, round_dots: { value: 1 } }));
    for (const object of [faces, mesh, dots, ...fields]) { object.frustumCulled = false; object.matrixAutoUpdate = false; this.scene.add(object); }
    for (const material of [mesh, dots, ...fields]) (material.material as RawShaderMaterial).transparent = true;
    return { faces, mesh, fields, dots, colours: attributes.colour, visible: true };
  }

  setTheme(theme: Theme): void {
    this.theme = theme;
    const accent = new Color().setStyle(theme.accent, '');
    for (const m of this.materials) m.uniforms.accent.value = accent;
  }

  colours(patch: number): Uint8Array { return this.drawn[patch].colours.array as Uint8Array; }
  coloursChanged(patch: number): void { this.drawn[patch].colours.needsUpdate = true; }
  show(patch: number, visible: boolean): void { this.drawn[patch].visible = visible; this.dropIds(); }
  isShown(patch: number): boolean { return this.drawn[patch].visible; }
  reset(): void { Object.assign(this.skinEye, this.home); Object.assign(this.mapEye, { x: 0, y: 0, zoom: 1 }); this.dropIds(); }
  dropIds(): void { this.ids = null; }

  resize(width: number, height: number, ratio: number): void {
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.dropIds();
  }

  /** How far the surfaces have turned, and how far they have flown to the sheet. */
  private phases(unfold: number): [number, number] {
    // One patch does both at once; several unroll at their links first, so that they do not cross.
    return this.patches.length === 1 ? [unfold, smooth(unfold)] : [smooth(unfold / 0.6), smooth((unfold - 0.6) / 0.4)];
  }

  private shares(t: number): number[] {
    const times = [0, 0.25, 0.5, 0.75, 1];
    return times.map((x, k) => times.reduce((w, y, j) => (j === k ? w : (w * (t - y)) / (x - y)), 1));
  }

  /** The axes of an eye: columns right, up, toward the viewer. */
  private axes(eye: Eye): [Vector3, Vector3, Vector3] {
    const { azimuth: a, elevation: e } = eye;
    const level = new Vector3(Math.cos(a), Math.sin(a), 0);
    const toward = level.clone().multiplyScalar(Math.cos(e)).add(new Vector3(0, 0, Math.sin(e)));
    const up = new Vector3(0, 0, Math.cos(e)).addScaledVector(level, -Math.sin(e));
    return [up.clone().cross(toward), up, toward];
  }

  /** Where the sheet stands in the world while the skin unfolds: facing the viewer, around what is seen. */
  private sheetStand(): Matrix4 {
    const [right, up, toward] = this.axes(this.skinEye);
    const stand = new Matrix4().makeBasis(right, up, toward);
    return stand.setPosition(this.centre).multiply(new Matrix4().makeTranslation(-this.sheet[0] / 2, -this.sheet[1] / 2, 0));
  }

  private setFolds(isMap: boolean): void {
    const unfold = isMap ? 1 : this.unfold;
    const [turned, flown] = isMap ? [1, 1] : this.phases(unfold);
    this.stands.shares.value = this.shares(turned);
    this.stands.lit.value = isMap ? 0 : 1 - flown;
    const stand = this.sheetStand();
    this.patches.forEach((patch, k) => {
      const { fold, flatPose } = this.folds[k];
      flatPose.copy(patch.flat);
      const there = isMap ? patch.toSheet : stand.clone().multiply(patch.toSheet);
      if (flown === 0) fold.copy(patch.pose);
      else if (flown === 1) fold.copy(there);
      else {
        const [from, to] = [patch.pose, there].map((m) => new Quaternion().setFromRotationMatrix(m));
        const turn = from.slerp(to, flown);
        const middle = patch.middle.clone().applyMatrix4(patch.pose).lerp(patch.middle.clone().applyMatrix4(there), flown);
        fold.compose(new Vector3(), turn, new Vector3(1, 1, 1));
        // At different depths, so that they do not cut through each other on their way.
        middle.addScaledVector(this.axes(this.skinEye)[2], (k + 0.5 - this.patches.length / 2) * this.storey * Math.sin(Math.PI * flown));
        fold.setPosition(middle.sub(patch.middle.clone().applyMatrix4(fold)));
      }
    });
  }

  /** Half of the height that a view shows, in m. */
  private half(isMap: boolean): number {
    const { width, height } = isMap ? this.map : this.skin;
    const aspect = Math.max(width, 1) / Math.max(height, 1);
    const ofMap = 0.54 * Math.max(this.sheet[1], this.sheet[0] / aspect);
    const ofSkin = 1.12 * Math.max(this.extent[1], this.extent[0] / aspect);
    if (isMap) return ofMap / this.mapEye.zoom;
    const flown = this.patches.length === 1 ? smooth(this.unfold) : smooth(this.unfold / 0.8);
    // Halfway it stands askew and needs more room.
    const room = 1 + 0.2 * Math.sin(Math.PI * this.unfold);
    return (room * (ofSkin + flown * (ofMap - ofSkin))) / this.skinEye.zoom;
  }

  /** Whether a place with this normal, in the frame of its link, faces the viewer of the skin; on the sheet all do. */
  faces(patch: number, normal: Vector3): boolean {
    return this.unfold > 0.5 || normal.clone().transformDirection(this.patches[patch].pose).dot(this.axes(this.skinEye)[2]) > -0.05;
  }

  /** Turns the skin so that a place with this normal faces the viewer. */
  turnTo(patch: number, normal: Vector3): void {
    const toward = normal.clone().transformDirection(this.patches[patch].pose);
    Object.assign(this.skinEye, { azimuth: Math.atan2(toward.y, toward.x), elevation: Math.atan2(toward.z, Math.hypot(toward.x, toward.y)) });
    this.dropIds();
  }

  metresPerPixel(isMap: boolean): number { return (2 * this.half(isMap)) / Math.max(1, (isMap ? this.map : this.skin).height); }

  private aim(isMap: boolean): void {
    const { width, height } = isMap ? this.map : this.skin;
    const half = this.half(isMap), aspect = Math.max(width, 1) / Math.max(height, 1);
    const eye = isMap ? this.mapEye : this.skinEye;
    Object.assign(this.camera, { left: -half * aspect, right: half * aspect, bottom: -half, top: half });
    const { reach } = this;
    Object.assign(this.camera, { near: 0, far: 2 * reach });
    this.camera.updateProjectionMatrix();
    const [right, up, toward] = isMap ? [new Vector3(1, 0, 0), new Vector3(0, 1, 0), new Vector3(0, 0, 1)] : this.axes(eye);
    const at = isMap ? new Vector3(this.sheet[0] / 2, this.sheet[1] / 2, 0) : this.centre.clone();
    at.addScaledVector(right, eye.x).addScaledVector(up, eye.y).addScaledVector(toward, reach);
    this.camera.matrixAutoUpdate = false;
    this.camera.matrix.makeBasis(right, up, toward).setPosition(at);
    this.camera.matrixWorld.copy(this.camera.matrix);
    this.camera.matrixWorldInverse.copy(this.camera.matrixWorld).invert();
  }

  private dress(isMap: boolean): void {
    const px = 1 / this.metresPerPixel(isMap), ratio = this.renderer.getPixelRatio();
    this.drawn.forEach((d, k) => {
      const spacing = this.patches[k].spacing * px;
      d.faces.visible = d.visible;
      d.mesh.visible = d.visible && this.hasLines && spacing > 7;
      d.dots.visible = d.visible && this.hasLines && spacing > 7;
      const nearer = (lines: Mesh | LineSegments | Points, m: number): void => { (lines.material as RawShaderMaterial).uniforms.nearer.value = m / this.reach; };
      const pitch = this.patches[k].spacing;
      nearer(d.mesh, 0.2 * pitch);
      nearer(d.dots, 0.25 * pitch);
      d.fields.forEach((lines, level) => nearer(lines, 0.3 * pitch * Math.sqrt(this.patches[k].taxels / this.patches[k].fields[level].vertices)));
      const [r, g, b] = this.theme.ink;
      (d.mesh.material as RawShaderMaterial).uniforms.ink.value = new Vector4(r, g, b, this.level > 0 ? 0.12 : 0.28);
      const dots = (d.dots.material as RawShaderMaterial).uniforms;
      dots.ink.value = new Vector4(r, g, b, 0.75);
      dots.dot_px.value = ratio * Math.min(5, Math.max(1.5, 0.2 * spacing));
      const { fields, most } = this.patches[k], shown = this.level < most ? Math.min(this.level, fields.length - 1) : -1;
      d.fields.forEach((lines, level) => {
        lines.visible = d.visible && this.hasLines && level > 0 && level === shown && (this.patches[k].spacing * px * Math.sqrt(this.patches[k].taxels / this.patches[k].fields[level].vertices) > 5);
        (lines.material as RawShaderMaterial).uniforms.ink.value = new Vector4(r, g, b, 0.6);
      });
    });
  }

  draw(): void {
    const { renderer } = this;
    renderer.setRenderTarget(null);
    renderer.setScissorTest(true);
    renderer.setClearColor(new Color(this.theme.background), 1);
    const total = this.canvas.clientHeight;
    for (const isMap of [false, true]) {
      const { x, y, width, height } = isMap ? this.map : this.skin;
      if (width < 2 || height < 2) continue;
      this.setFolds(isMap);
      this.aim(isMap);
      this.dress(isMap);
      renderer.setViewport(x, total - y - height, width, height);
      renderer.setScissor(x, total - y - height, width, height);
      renderer.clear();
      renderer.render(this.scene, this.camera);
    }
    renderer.setScissorTest(false);
  }

  /** The place of the sheet that the skin shows at a pixel of its view; `null` off the skin. */
  sheetAt(x: number, y: number): [number, number] | null {
    const width = Math.floor(this.skin.width), height = Math.floor(this.skin.height);
    if (!this.ids) this.ids = this.drawIds(width, height);
    const { pixels } = this.ids;
    // The nearest pixel within a ring: small taxels are easy to meet.
    let best: [number, number] | null = null, far = 10;
    for (let dy = -3; dy <= 3; dy++) for (let dx = -3; dx <= 3; dx++) {
      const px = Math.floor(x) + dx, py = height - 1 - Math.floor(y) + dy, d = dx * dx + dy * dy;
      if (px < 0 || py < 0 || px >= width || py >= height || d >= far) continue;
      const k = 4 * (py * width + px);
      if (pixels[k] === 255 && pixels[k + 1] === 255) continue;
      far = d;
      best = [pixels[k] * 256 + pixels[k + 1], pixels[k + 2] * 256 + pixels[k + 3]].map((n, a) => (n / 65534) * this.sheet[a]) as [number, number];
    }
    return best;
  }

  private drawIds(width: number, height: number): { target: WebGLRenderTarget; pixels: Uint8Array } {
    const target = new WebGLRenderTarget(width, height);
    const pixels = new Uint8Array(4 * width * height);
    this.setFolds(false);
    this.aim(false);
    this.scene.matrixWorldAutoUpdate = false;
    for (const d of this.drawn) { d.faces.visible = d.visible; d.mesh.visible = d.dots.visible = false; d.fields.forEach((f) => { f.visible = false; }); }
    const kept = this.drawn.map((d) => d.faces.material);
    this.renderer.setRenderTarget(target);
    this.renderer.setClearColor(new Color(1, 1, 1), 1);
    this.renderer.clear();
    this.drawn.forEach((d, k) => {
      this.place.uniforms.fold.value = this.folds[k].fold;
      this.place.uniforms.flatPose.value = this.folds[k].flatPose;
      this.drawn.forEach((other) => { other.faces.visible = other === d && d.visible; });
      d.faces.material = this.place;
      this.place.uniformsNeedUpdate = true;
      this.renderer.render(this.scene, this.camera);
      d.faces.material = kept[k];
    });
    this.renderer.readRenderTargetPixels(target, 0, 0, width, height, pixels);
    this.renderer.setRenderTarget(null);
    target.dispose();
    return { target, pixels };
  }

  /** The place of the sheet under a pixel of the map's view. */
  mapAt(x: number, y: number): [number, number] {
    const m = this.metresPerPixel(true);
    return [this.sheet[0] / 2 + this.mapEye.x + (x - this.map.width / 2) * m, this.sheet[1] / 2 + this.mapEye.y - (y - this.map.height / 2) * m];
  }

  /** The pixel of the canvas that shows a place of the sheet in the map's view. */
  mapPixel(x: number, y: number): [number, number] {
    const m = this.metresPerPixel(true), { map, mapEye, sheet } = this;
    return [map.x + map.width / 2 + (x - sheet[0] / 2 - mapEye.x) / m, map.y + map.height / 2 - (y - sheet[1] / 2 - mapEye.y) / m];
  }

  /** Where a weighted mean of places is on the page, in pixels of the canvas, in either view. */
  toPixels(isMap: boolean, patch: number, places: [number, number][]): [number, number] {
    this.setFolds(isMap);
    this.aim(isMap);
    const p = this.patches[patch], shares = this.stands.shares.value, sum = new Vector3(), at = new Vector3();
    for (const [place, w] of places) {
      p.keys.forEach((key, k) => sum.addScaledVector(at.fromArray(key, 3 * place), w * shares[k]));
      sum.addScaledVector(at.set(p.sheet[2 * place], p.sheet[2 * place + 1], 0).applyMatrix4(p.flat), w * shares[4]);
    }
    sum.applyMatrix4(this.folds[patch].fold).applyMatrix4(this.camera.matrixWorldInverse).applyMatrix4(this.camera.projectionMatrix);
    const { x, y, width, height } = isMap ? this.map : this.skin;
    return [x + (0.5 + 0.5 * sum.x) * width, y + (0.5 - 0.5 * sum.y) * height];
  }

  image(): string { this.draw(); return this.canvas.toDataURL('image/png'); }
}
