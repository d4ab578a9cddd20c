// Eye-dome lighting (Boucheny 2009): what lies behind its neighbors is darker, so that shapes stand out without normals.
import {
  DepthTexture,
  Mesh,
  OrthographicCamera,
  PlaneGeometry,
  Scene,
  ShaderMaterial,
  Vector2,
  WebGLRenderTarget,
} from "three";

const SAMPLES = 4; // of each pixel
const REACHES = [1 / 320, 1 / 110]; // distances of neighbors, shares of the stage's shorter side

const VERTEX = `
  varying vec2 place;
  void main() {
    place = uv;
    gl_Position = vec4(position.xy, 0.0, 1.0);
  }`;
const FRAGMENT = `
  uniform sampler2D image;
  uniform sampler2D depths;
  uniform vec2 pixels;
  uniform float near;
  uniform float far;
  varying vec2 place;
  float depthAt(vec2 at) { // distance from the camera
    float z = texture2D(depths, at).x;
    return near * far / (far - z * (far - near));
  }
  void main() {
    vec4 color = texture2D(image, place);
    if (texture2D(depths, place).x < 1.0) {
      float depth = depthAt(place);
      float side = min(pixels.x, pixels.y);
      float nearer = 0.0;
      for (int ring = 0; ring < 2; ring++) {
        float reach = side * (ring == 0 ? ${REACHES[0].toFixed(5)} : ${REACHES[1].toFixed(5)});
        for (int index = 0; index < 8; index++) {
          float angle = 0.785398 * float(index) + 0.39 * float(ring);
          vec2 beside = place + reach * vec2(cos(angle), sin(angle)) / pixels;
          nearer += clamp(depth - depthAt(beside), 0.0, 0.1);
        }
      }
      color.rgb *= exp(-0.8 * nearer);
    }
    gl_FragColor = color;
  }`;

export class EyeDome {
  constructor() {
    this.target = new WebGLRenderTarget(1, 1, { samples: SAMPLES, depthTexture: new DepthTexture(1, 1) });
    this.target.scissorTest = true;
    this.uniforms = {
      image: { value: this.target.texture },
      depths: { value: this.target.depthTexture },
      pixels: { value: new Vector2() },
      near: { value: 0 },
      far: { value: 0 },
    };
    this.camera = new OrthographicCamera();
    this.scene = new Scene();
    const material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: this.uniforms,
      depthTest: false,
      depthWrite: false,
    });
    const screen = new Mesh(new PlaneGeometry(2, 2), material);
    screen.frustumCulled = false;
    this.scene.add(screen);
  }

  /** Start a frame of this many device pixels. */
  begin(renderer, width, height) {
    const [across, down] = [Math.max(1, Math.round(width)), Math.max(1, Math.round(height))];
    this.target.setSize(across, down);
    this.uniforms.pixels.value.set(across, down);
    this.target.viewport.set(0, 0, across, down);
    this.target.scissor.set(0, 0, across, down);
    renderer.setRenderTarget(this.target);
    renderer.clear();
  }

  /** Draw a scene into a cell: [left, bottom, width, height], device pixels. */
  draw(renderer, cell, scene, camera) {
    this.target.viewport.set(...cell);
    this.target.scissor.set(...cell);
    renderer.setRenderTarget(this.target);
    renderer.render(scene, camera);
  }

  /** Put the lit frame on the canvas. */
  end(renderer, camera) {
    this.uniforms.near.value = camera.near;
    this.uniforms.far.value = camera.far;
    renderer.setRenderTarget(null);
    renderer.clear();
    renderer.render(this.scene, this.camera);
  }
}
