// The light of the room, as the device estimates it; until it does, a soft one from above.
import { DirectionalLight, HemisphereLight, LightProbe } from "three";

export class Light {
  constructor(scene) {
    this.sky = new HemisphereLight("white", "#999", 2);
    this.sun = new DirectionalLight("white", 1.5);
    this.sun.position.set(-0.4, 1, 0.8);
    this.around = new LightProbe();
    scene.add(this.sky, this.sun, this.around);
  }

  /** Ask for estimates; sessions without the feature have none. */
  async start(session) {
    this.probe = await session.requestLightProbe?.().catch(() => undefined);
  }

  /** Take the latest estimate (WebXR Lighting Estimation API, section 4.2). */
  update(frame) {
    const estimate = this.probe && frame.getLightEstimate(this.probe);
    if (!estimate) return;
    const { sphericalHarmonicsCoefficients, primaryLightIntensity: { x, y, z }, primaryLightDirection } = estimate;
    const strength = Math.max(1, x, y, z);
    this.sky.intensity = 0;
    this.around.sh.fromArray(sphericalHarmonicsCoefficients);
    this.sun.color.setRGB(x / strength, y / strength, z / strength);
    this.sun.intensity = strength;
    this.sun.position.copy(primaryLightDirection);
  }
}
