// What the viewer of `eaves view --serve` takes from its two libraries.
export {
  BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, EdgesGeometry, Group, HemisphereLight, LineBasicMaterial,
  LineSegments, Matrix4, Mesh, MeshLambertMaterial, PerspectiveCamera, Raycaster, SRGBColorSpace, Scene, Sphere, TextureLoader, Vector2,
  Vector3, WebGLRenderer,
} from 'three';
export { MapControls } from 'three/examples/jsm/controls/MapControls.js';
export { TilesRenderer } from '3d-tiles-renderer/three';
export { GLTFExtensionsPlugin } from '3d-tiles-renderer/three/plugins';
