/**
 * Reads binary FBX files for a preview: meshes in their places, skinned as the bones stand, with blend shapes, colours, textures and lamps.
 * Animation, subdivision, text files and versions before 7.0 are left to the service.
 */

import { pictureType } from "./files.js";
import { arrayOf, childOf, nodesOf, propertiesOf } from "./fbx-nodes.js";
import { IDENTITY, cofactors, product, rotation, scaling, translation, transposed } from "./matrix.js";
import { GREY, coded, modelOf } from "./model.js";
import { isCutFromFirst, trianglesOf } from "./polygons.js";
import { orbitView } from "./shapes.js";
import { OMNI, dielectric, phongRoughness } from "./surface.js";

/** @typedef {import("./fbx-nodes.js").Node} Node */
/** @typedef {import("./fbx-nodes.js").Value} Value */
/** @typedef {import("./model.js").Part} Part */
/** @typedef {import("./shapes.js").Picture} Picture */
/** @typedef {import("./shapes.js").Shape} Shape */
/** @typedef {Map<string, Value[]>} Properties */
/** @typedef {{node: Node, kind: string, properties: Properties}} Thing an object of the file; kind: its class, such as "Mesh" */
/** isKnown: whether the service reads the same. @typedef {{color: number[], image: Picture | null, surface: Partial<import("../news/mesh-packet.js").MeshMaterial>, isKnown: boolean}} Material */

const ORDERS = ["xyz", "xzy", "yzx", "yxz", "zxy", "zyx"];
const MOST_DEPTH = 256;
const MOST_CORNERS = 30_000_000; // of all triangles before they are decimated, each instance of a mesh with its own
const [INCH, CENTIMETRES] = [25.4, 100];
const [DIRECTIONAL, SPOT, AREA] = [1, 2, 3]; // light types
const QUADRATIC = 2; // decay of a light

/** Adds a value to the list of a key. @template V @param {Map<string, V[]>} lists @param {string} key @param {V} value */
function append(lists, key, value) {
  const list = lists.get(key);
  if (list) list.push(value);
  else lists.set(key, [value]);
}

/** The objects of a file, and how they are connected. */
class Scene {
  /** @param {Node[]} nodes */
  constructor(nodes) {
    /** @type {Map<string, Thing>} by id */
    this.things = new Map();
    /** @type {Map<string, {id: string, property: string}[]>} */
    this.children = new Map();
    /** @type {Map<string, string[]>} */
    this.parents = new Map();
    /** @type {Map<string, number[]>} of the models, to world space */
    this.worlds = new Map();
    /** @type {Map<string, string | undefined>} */
    this.finestOf = new Map();
    /** Images in the file, by their bytes. @type {Map<Uint8Array, Picture>} */
    this.pictures = new Map();
    this.isBlenders = String(childOf(nodes.find(({ name }) => name === "FBXHeaderExtension"), "Creator")?.values[0] ?? "").startsWith("Blender");
    const templates = nodes.find(({ name }) => name === "Definitions")?.children.filter(({ name }) => name === "ObjectType") ?? [];
    /** Default properties of materials. */
    this.materialDefaults = propertiesOf(childOf(templates.find(({ values }) => values[0] === "Material"), "PropertyTemplate"));
    this.settings = propertiesOf(nodes.find(({ name }) => name === "GlobalSettings"));
    this.root = rootOf(this.settings);
    for (const node of nodes.find(({ name }) => name === "Objects")?.children ?? [])
      this.things.set(String(node.values[0]), { node, kind: String(node.values[2]), properties: propertiesOf(node) });
    for (const { values } of nodes.find(({ name }) => name === "Connections")?.children ?? []) {
      const [child, parent] = [String(values[1]), String(values[2])];
      append(this.children, parent, { id: child, property: String(values[3] ?? "") });
      append(this.parents, child, parent);
    }
  }

  /** @param {string} name of the objects' nodes, such as "Model" @param {string} [kind] @returns {[string, Thing][]} with their ids */
  all(name, kind) {
    return [...this.things].filter(([, thing]) => thing.node.name === name && (!kind || thing.kind === kind));
  }

  /** @param {string} id @param {string} name @param {string} [kind] @returns {[string, Thing][]} the objects below another one, with their ids */
  below(id, name, kind) {
    return (this.children.get(id) ?? []).flatMap(({ id: child }) => {
      const thing = this.things.get(child);
      return thing?.node.name === name && (!kind || thing.kind === kind) ? [/** @type {[string, Thing]} */ ([child, thing])] : [];
    });
  }

  /** @param {string} id @returns {string | undefined} the model above a model */
  above(id) {
    return this.parents.get(id)?.find((parent) => this.things.get(parent)?.node.name === "Model");
  }

  /** @param {string} id @param {number} [depth] @returns {number[]} */
  world(id, depth = 0) {
    const known = this.worlds.get(id);
    if (known) return known;
    const parent = depth < MOST_DEPTH ? this.above(id) : undefined;
    const found = product(parent === undefined ? this.root : this.world(parent, depth + 1), ownMatrix(this.things.get(id)?.properties ?? new Map()));
    this.worlds.set(id, found);
    return found;
  }

  /** @param {string} id @param {number} [depth] @returns {boolean} whether a model and those above it are shown */
  isShown(id, depth = 0) {
    const properties = this.things.get(id)?.properties;
    if (properties?.get("Visibility")?.[0] === 0 || properties?.get("Show")?.[0] === 0) return false;
    const parent = this.above(id);
    if (parent === undefined || depth > MOST_DEPTH) return true;
    return [undefined, id].includes(this.finest(parent)) && this.isShown(parent, depth + 1);
  }

  /** @param {string} id @returns {string | undefined} the one model that is shown of a group with levels of detail; undefined for other models */
  finest(id) {
    if (!this.finestOf.has(id)) this.finestOf.set(id, this.below(id, "NodeAttribute", "LodGroup").length ? this.below(id, "Model")[0]?.[0] : undefined);
    return this.finestOf.get(id);
  }
}

/**
 * @param {Uint8Array<ArrayBuffer>} file
 * @param {(reference: string) => Promise<Picture | null>} picture returns an image that the file names
 * @param {number} [most] triangles, about
 * @returns {Promise<import("./shapes.js").LocalMesh | null>} null if only the service can read it
 */
export async function readFbx(file, picture, most) {
  const nodes = nodesOf(file);
  if (!nodes) return null;
  const scene = new Scene(nodes);
  /** @type {Map<string, Promise<Material>>} */
  const materials = new Map();
  /** @type {Part[]} */
  const parts = [];
  let corners = 0;
  let isWhole = !scene.all("AnimationCurve").length;
  for (const [id] of scene.all("Model")) {
    if (!scene.isShown(id)) continue;
    for (const [geometry, thing] of scene.below(id, "Geometry", "Mesh")) {
      isWhole &&= !scene.below(geometry, "Deformer").length;
      const shapes = await shapesOf(thing.node, await placing(scene, id, geometry), await blendedPoints(scene, geometry, thing.node));
      const slots = scene.below(id, "Material");
      for (const [slot, shape] of shapes) {
        corners += shape.indices.length;
        if (corners > MOST_CORNERS) return null;
        const [key, material] = slots[slot] ?? ["", undefined];
        if (!materials.has(key)) materials.set(key, material ? materialOf(scene, key, material, picture) : Promise.resolve({ color: GREY, image: null, surface: {}, isKnown: true }));
        const { color, image, surface, isKnown } = await /** @type {Promise<Material>} */ (materials.get(key));
        isWhole &&= isKnown;
        parts.push({ shape: image ? { ...shape, colors: null } : shape, color, image, surface });
      }
    }
  }
  const isRead = isWhole && parts.some(({ image }) => image); // else its textures may be of types that only the service reads
  const found = modelOf(parts, IDENTITY, isRead, most, { lamps: lampsOf(scene, [0, 0, 0]), camera: (low, high) => cameraOf(scene, low, high) });
  const lamps = found ? lampsOf(scene, /** @type {import("./shapes.js").Vec3} */ (found.packet.low.map((value, i) => (value + (found.packet.high[i] ?? 0)) / 2))) : [];
  if (found && lamps.length) found.packet.lamps = lamps;
  return found;
}

/** @param {Properties} properties @param {string} name @param {number} otherwise @returns {number} */
const numberIn = (properties, name, otherwise) => Number(properties.get(name)?.[0] ?? otherwise);

/** @param {Properties} properties @param {string} name @param {number[]} [otherwise] @returns {number[]} */
const vectorIn = (properties, name, otherwise = [0, 0, 0]) => properties.get(name)?.slice(0, 3).map(Number) ?? otherwise;

/** Returns the matrix from the file's axes and unit to X right, Y up, Z to the front, and metres. @param {Properties} settings */
function rootOf(settings) {
  const scale = numberIn(settings, "UnitScaleFactor", 1) / CENTIMETRES;
  const matrix = IDENTITY.map(() => 0);
  [["CoordAxis", 0], ["UpAxis", 1], ["FrontAxis", 2]].forEach(([name, axis], row) => {
    const column = numberIn(settings, String(name), Number(axis));
    matrix[4 * (column >= 0 && column < 3 ? column : Number(axis)) + row] = scale * Math.sign(numberIn(settings, `${name}Sign`, 1));
  });
  matrix[15] = 1;
  return matrix;
}

/** Returns a model's transform to its parent. Source: Autodesk, FBX SDK documentation, "Computing transformation matrices". @param {Properties} properties */
function ownMatrix(properties) {
  const at = (/** @type {string} */ name) => vectorIn(properties, name);
  const isActive = numberIn(properties, "RotationActive", 0) !== 0 && numberIn(properties, "RotationSpaceForLimitOnly", 0) === 0;
  const order = isActive ? (ORDERS[numberIn(properties, "RotationOrder", 0)] ?? "xyz") : "xyz";
  const turn = rotation(at("Lcl Rotation"), order);
  const turned = isActive ? [rotation(at("PreRotation")), turn, transposed(rotation(at("PostRotation")))] : [turn];
  return [
    ...[translation(at("Lcl Translation")), translation(at("RotationOffset")), translation(at("RotationPivot")), ...turned],
    ...[translation(at("RotationPivot"), -1), translation(at("ScalingOffset")), translation(at("ScalingPivot"))],
    ...[scaling(vectorIn(properties, "Lcl Scaling", [1, 1, 1])), translation(at("ScalingPivot"), -1)],
  ].reduce(product);
}

/**
 * Returns a function that places the points of a geometry in the world: by its model or, where it has a skin, by its bones.
 *
 * @param {Scene} scene
 * @param {string} model
 * @param {string} geometry
 * @returns {Promise<Placing>}
 */
async function placing(scene, model, geometry) {
  const properties = scene.things.get(model)?.properties ?? new Map();
  const at = (/** @type {string} */ name) => vectorIn(properties, name);
  const own = [translation(at("GeometricTranslation")), rotation(at("GeometricRotation")), scaling(vectorIn(properties, "GeometricScaling", [1, 1, 1]))].reduce(product);
  const matrix = product(scene.world(model), own);
  const skin = scene.below(geometry, "Deformer", "Skin")[0]?.[0];
  if (skin === undefined) return { matrix, joints: [] };
  const joints = [];
  let weighted = 0;
  for (const [cluster, { node }] of scene.below(skin, "Deformer", "Cluster")) {
    const bone = scene.below(cluster, "Model")[0]?.[0];
    const [indices, weights, transform] = [await arrayOf(node, "Indexes"), await arrayOf(node, "Weights"), await arrayOf(node, "Transform")];
    weighted += Math.max(indices?.length ?? 0, weights?.length ?? 0);
    if (weighted > MOST_CORNERS) throw new RangeError("too many weights"); // a file may name a cluster any number of times
    if (bone !== undefined && indices && weights && transform?.length === 16) joints.push({ indices, weights, matrix: product(scene.world(bone), product([...transform], own)) });
  }
  return { matrix, joints };
}

/** @typedef {{matrix: number[], joints: {indices: Int32Array, weights: Float64Array, matrix: number[]}[]}} Placing */

/** @param {Float64Array} points @param {Placing} placing @returns {Float32Array} the points in the world */
function placed(points, { matrix, joints }) {
  const found = new Float32Array(points.length);
  const sums = new Float64Array(joints.length ? points.length : 0);
  const weight = new Float64Array(joints.length ? points.length / 3 : 0);
  /** @param {number[]} m @param {number} i @param {number} share @param {Float32Array | Float64Array} to */
  const add = ([a = 0, b = 0, c = 0, , d = 0, e = 0, f = 0, , g = 0, h = 0, k = 0, , x = 0, y = 0, z = 0], i, share, to) => {
    const [u = 0, v = 0, w = 0] = [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
    to[3 * i] = (to[3 * i] ?? 0) + share * (a * u + d * v + g * w + x);
    to[3 * i + 1] = (to[3 * i + 1] ?? 0) + share * (b * u + e * v + h * w + y);
    to[3 * i + 2] = (to[3 * i + 2] ?? 0) + share * (c * u + f * v + k * w + z);
  };
  for (const joint of joints)
    joint.indices.forEach((i, k) => {
      const share = joint.weights[k] ?? 0;
      if (i < 0 || i >= weight.length || !(share > 0)) return;
      add(joint.matrix, i, share, sums);
      weight[i] = (weight[i] ?? 0) + share;
    });
  for (let i = 0; i < points.length / 3; i++) {
    const total = weight[i] ?? 0;
    if (total > 0) for (let axis = 0; axis < 3; axis++) found[3 * i + axis] = (sums[3 * i + axis] ?? 0) / total;
    else add(matrix, i, 1, found);
  }
  return found;
}

/**
 * Returns the points of a geometry with its blend shapes, in the proportions that its file states. Shapes in between others, of channels
 * with several, are left to the service.
 *
 * @param {Scene} scene
 * @param {string} id
 * @param {Node} geometry
 * @returns {Promise<{points: Float64Array | null, isBlended: boolean}>}
 */
async function blendedPoints(scene, id, geometry) {
  const points = await arrayOf(geometry, "Vertices");
  let [isBlended, moved] = [false, 0];
  let found = points;
  for (const [blend] of scene.below(id, "Deformer", "BlendShape"))
    for (const [channel, { node, properties }] of scene.below(blend, "Deformer", "BlendShapeChannel")) {
      const share = Number(properties.get("DeformPercent")?.[0] ?? childOf(node, "DeformPercent")?.values[0] ?? 0) / 100;
      const [shape, ...others] = scene.below(channel, "Geometry", "Shape");
      if (!points || !shape || others.length || !share || !Number.isFinite(share)) continue;
      const [indices, offsets] = [await arrayOf(shape[1].node, "Indexes"), await arrayOf(shape[1].node, "Vertices")];
      moved += indices?.length ?? 0;
      if (moved > MOST_CORNERS) throw new RangeError("too many blend shapes"); // a file may name a shape any number of times
      const blended = isBlended && found ? found : Float64Array.from(points);
      indices?.forEach((/** @type {number} */ index, /** @type {number} */ i) => {
        for (let axis = 0; axis < 3; axis++) blended[3 * index + axis] = (blended[3 * index + axis] ?? 0) + share * (offsets?.[3 * i + axis] ?? 0);
      });
      [found, isBlended] = [blended, true];
    }
  return { points: found, isBlended };
}

/**
 * Returns the triangles of a geometry in the world, by the slots of their materials.
 *
 * @param {Node} geometry
 * @param {Placing} placing
 * @param {{points: Float64Array | null, isBlended: boolean}} blended
 * @returns {Promise<[number, Shape][]>}
 */
async function shapesOf(geometry, placing, { points, isBlended }) {
  const polygons = await arrayOf(geometry, "PolygonVertexIndex");
  if (!points || !polygons) return [];
  const positions = placed(points, placing);
  const isDeformed = isBlended || placing.joints.length > 0;
  const normals = isDeformed ? null : await layerOf(geometry, "LayerElementNormal", "Normals", "NormalsIndex", 3, polygons);
  const uvs = await layerOf(geometry, "LayerElementUV", "UV", "UVIndex", 2, polygons);
  const colors = await layerOf(geometry, "LayerElementColor", "Colors", "ColorIndex", 4, polygons);
  const layer = childOf(geometry, "LayerElementMaterial");
  const slots = childOf(layer, "MappingInformationType")?.values[0] === "ByPolygon" ? await arrayOf(layer, "Materials") : null;
  /** @type {Map<number, number[]>} corners of each slot's triangles */
  const bySlot = new Map();
  for (let first = 0, polygon = 0, corner = 0; corner < polygons.length; corner++) {
    if (polygons[corner] >= 0) continue;
    const slot = slots?.[polygon++] ?? 0;
    const corners = bySlot.get(slot) ?? [];
    bySlot.set(slot, corners);
    cut(points, polygons, first, corner + 1 - first, corners);
    first = corner + 1;
  }
  const turn = cofactors(placing.matrix);
  return [...bySlot].map(([slot, corners]) => {
    const count = corners.length;
    /** @type {Shape} */
    const shape = {
      ...{ positions: new Float32Array(3 * count), normals: normals && new Float32Array(3 * count), uvs: uvs && new Float32Array(2 * count) },
      ...{ colors: colors && new Uint8Array(3 * count), indices: new Uint32Array(count) },
    };
    corners.forEach((corner, i) => {
      const index = polygons[corner] < 0 ? ~polygons[corner] : polygons[corner];
      shape.indices[i] = i;
      for (let axis = 0; axis < 3; axis++) {
        shape.positions[3 * i + axis] = positions[3 * index + axis] ?? NaN;
        if (normals && shape.normals) shape.normals[3 * i + axis] = [0, 1, 2].reduce((sum, k) => sum + (turn[3 * k + axis] ?? 0) * (normals[3 * corner + k] ?? 0), 0);
      }
      if (uvs && shape.uvs) shape.uvs.set([uvs[2 * corner] ?? 0, 1 - (uvs[2 * corner + 1] ?? 0)], 2 * i); // FBX measures v from the lower edge
      if (colors && shape.colors) shape.colors.set(coded([...colors.subarray(4 * corner, 4 * corner + 3)]), 3 * i);
    });
    return [slot, shape];
  });
}

/**
 * Adds the corners of a polygon's triangles to a list.
 *
 * @param {Float64Array} points
 * @param {Int32Array} polygons
 * @param {number} first corner of the polygon
 * @param {number} count of its corners
 * @param {number[]} corners
 */
function cut(points, polygons, first, count, corners) {
  const point = (/** @type {number} */ corner) => {
    const index = polygons[first + corner] ?? 0;
    return index < 0 ? ~index : index;
  };
  if (count === 3) corners.push(first, first + 1, first + 2);
  else if (count === 4) {
    const from = isCutFromFirst(points, point(0), point(1), point(2), point(3)) ? 0 : 1;
    corners.push(first + from, first + from + 1, first + from + 2, first + from, first + from + 2, first + ((from + 3) % 4));
  } else {
    const place = (/** @type {number} */ corner) => /** @type {import("./shapes.js").Vec3} */ ([0, 1, 2].map((axis) => points[3 * point(corner) + axis] ?? 0));
    for (const corner of trianglesOf(count, place)) corners.push(first + corner);
  }
}

/**
 * Returns the values of a layer at the corners of the polygons.
 *
 * @param {Node} geometry
 * @param {string} layer
 * @param {string} name of its values
 * @param {string} indexed name of its indices
 * @param {number} width
 * @param {Int32Array} polygons
 * @returns {Promise<Float32Array | null>} null if there is none, or if it is mapped otherwise than by corner or by vertex
 */
async function layerOf(geometry, layer, name, indexed, width, polygons) {
  const node = childOf(geometry, layer);
  const values = await arrayOf(node, name);
  const mapping = childOf(node, "MappingInformationType")?.values[0];
  const isByCorner = mapping === "ByPolygonVertex";
  if (!values || !(isByCorner || mapping === "ByVertice" || mapping === "ByVertex")) return null;
  const indices = childOf(node, "ReferenceInformationType")?.values[0] === "Direct" ? null : await arrayOf(node, indexed);
  const found = new Float32Array(width * polygons.length);
  polygons.forEach((point, corner) => {
    const at = isByCorner ? corner : point < 0 ? ~point : point;
    const row = indices ? (indices[at] ?? -1) : at;
    for (let k = 0; k < width; k++) found[width * corner + k] = values[width * row + k] ?? 0;
  });
  return found;
}

/** @param {Scene} scene @param {string} id @param {Thing} thing @param {(reference: string) => Promise<Picture | null>} picture @returns {Promise<Material>} */
async function materialOf(scene, id, { node, properties: stated }, picture) {
  const properties = new Map([...scene.materialDefaults, ...stated]);
  const emission = /** @type {import("./shapes.js").Vec3} */ (vectorIn(properties, "EmissiveColor").map((value) => value * numberIn(properties, "EmissiveFactor", 1)));
  const factor = numberIn(properties, "DiffuseFactor", 1);
  const connected = scene.children.get(id) ?? [];
  const texture = connected.find(({ property }) => property === "DiffuseColor")?.id;
  const image = texture === undefined ? null : await imageOf(scene, texture, picture);
  const color = image ? [factor, factor, factor] : vectorIn(properties, "DiffuseColor", [0.8, 0.8, 0.8]).map((value) => value * factor);
  // Renderers' own materials, and further textures, are left to the service.
  const isKnown = ![...stated.keys()].some((name) => name.includes("|")) && !connected.some(({ property }) => property && property !== "DiffuseColor" && !property.startsWith("Bump"));
  const { opacity, ...surface } = { ...surfaceOf(properties, String(childOf(node, "ShadingModel")?.values[0]), scene.isBlenders), emission };
  const mode = opacity < 1 ? /** @type {const} */ ("blend") : /** @type {const} */ ("opaque");
  return { color: [...coded(color), Math.round(255 * opacity)], image, surface: { ...surface, alpha_mode: mode }, isKnown };
}

/** Blender's exporter writes 0.25 for a reflectance of 4 %. */
const BLENDERS_PLASTIC = 0.25;

/**
 * Returns how a material by Lambert or Phong reflects, as renderer/scene/readers/fbx/materials.py does. Blender's exporter stores its own
 * parameters in Phong's.
 *
 * @param {Properties} properties
 * @param {string} model
 * @param {boolean} isBlenders
 */
function surfaceOf(properties, model, isBlenders) {
  const at = (/** @type {string} */ name, otherwise = 0) => numberIn(properties, name, otherwise);
  const through = Math.max(...vectorIn(properties, "TransparentColor").map((value) => value * at("TransparencyFactor", 1)));
  const opacity = through > 0 && through < 1 ? 1 - through : 1; // some exporters write 0 for opaque
  if (!model.toLowerCase().startsWith("phong")) return { opacity };
  if (isBlenders) {
    const roughness = Math.min(Math.max(1 - Math.sqrt(Math.max(at("Shininess", 25), 0)) / 10, 0), 1);
    const [metallic, level] = [Math.min(at("ReflectionFactor"), 1), Math.min(at("SpecularFactor", BLENDERS_PLASTIC) / BLENDERS_PLASTIC, 1)];
    return { roughness, metallic, f0: dielectric(1.5, [1, 1, 1], level), opacity: Math.max(1 - at("TransparencyFactor"), 0) || 1 };
  }
  const specular = vectorIn(properties, "SpecularColor").map((value) => Math.min(value * at("SpecularFactor", 1), 1));
  return { ...(Math.max(...specular) > 0 && { roughness: phongRoughness(at("ShininessExponent", at("Shininess", 20))), f0: dielectric(1.5, specular) }), opacity };
}

/** @param {Scene} scene @param {string} texture @param {(reference: string) => Promise<Picture | null>} picture @returns {Promise<Picture | null>} */
async function imageOf(scene, texture, picture) {
  const video = scene.below(texture, "Video")[0]?.[1].node;
  const names = [video, scene.things.get(texture)?.node].flatMap((node) => ["RelativeFilename", "FileName", "Filename"].map((name) => childOf(node, name)?.values[0]));
  const named = names.filter((name) => typeof name === "string" && name !== "").map(String);
  const content = childOf(video, "Content")?.values[0];
  const type = pictureType(named[0] ?? "");
  if (content instanceof Uint8Array && content.length && type) {
    const found = scene.pictures.get(content) ?? { bytes: content, type };
    scene.pictures.set(content, found);
    return found;
  }
  for (const name of named) {
    const found = await picture(name);
    if (found) return found;
  }
  return null;
}

/**
 * Returns the file's lamps, as strong as renderer/scene/readers/fbx/lights.py reads them: Blender writes watts, and other programs' lamps
 * of 100 % light a white surface fully.
 *
 * @param {Scene} scene
 * @param {import("./shapes.js").Vec3} middle of the scene
 * @returns {import("./shapes.js").Lamp[]}
 */
function lampsOf(scene, middle) {
  return scene.all("Model", "Light").flatMap(([id]) => {
    const properties = scene.below(id, "NodeAttribute", "Light")[0]?.[1].properties;
    if (!properties || !scene.isShown(id)) return [];
    const stated = (/** @type {string} */ name, otherwise = 0) => numberIn(properties, name, otherwise);
    const type = stated("LightType");
    const isFar = type === DIRECTIONAL;
    const world = scene.world(id);
    const at = vectorAt(world, isFar ? 4 : 12); // lamps shine along -Y
    const radiance = (stated("Intensity", 100) / 100) * strengthOf(scene, type, stated("DecayType"), Math.hypot(...at.map((value, i) => value - (middle[i] ?? 0))));
    const color = /** @type {import("./shapes.js").Vec3} */ (vectorIn(properties, "Color", [1, 1, 1]).map((value) => Math.max(value * radiance, 0) || 0));
    if (type !== SPOT && type !== AREA) return [{ ...OMNI, at, far: isFar, color }];
    const down = vectorAt(world, 4);
    const axis = /** @type {import("./shapes.js").Vec3} */ (down.map((value) => -value / (Math.hypot(...down) || 1)));
    const outer = Math.cos((stated("OuterAngle", 45) * Math.PI) / 360);
    const blend = 1 - stated("InnerAngle") / Math.max(stated("OuterAngle", 45), 1e-3); // Blender's is a part of the cosine
    const inner = Math.max(scene.isBlenders ? outer + (1 - outer) * blend : Math.cos((stated("InnerAngle") * Math.PI) / 360), outer + 1e-3);
    return [{ at, far: isFar, color, axis, cosines: /** @type {[number, number]} */ (type === SPOT ? [outer, inner] : [0, 1]) }];
  });
}

/** Returns the radiance that a lamp of 100 % gives a white surface at a distance in metres. @param {Scene} scene @param {number} type @param {number} decay @param {number} away */
function strengthOf(scene, type, decay, away) {
  if (type === DIRECTIONAL) return scene.isBlenders ? 1 / Math.PI : 1;
  const square = Math.max(away, 1e-3) ** 2;
  if (scene.isBlenders) return (type === AREA ? 1 / Math.PI : 1 / (4 * Math.PI)) / (Math.PI * square);
  const unit = numberIn(scene.settings, "UnitScaleFactor", 1) / CENTIMETRES;
  if (type === AREA) return unit ** 2 / (Math.PI * square); // a square with a side of one unit
  return decay === QUADRATIC ? unit ** 2 / square : 1;
}

/** Returns three values of a matrix as a vector. @param {number[]} matrix @param {number} first */
const vectorAt = (matrix, first) => /** @type {import("./shapes.js").Vec3} */ ([0, 1, 2].map((i) => matrix[first + i] ?? 0));

/** Returns the view through the file's default or first perspective camera. @param {Scene} scene @param {import("./shapes.js").Vec3} low @param {import("./shapes.js").Vec3} high */
function cameraOf(scene, low, high) {
  const wanted = scene.settings.get("DefaultCamera")?.[0];
  const found = scene.all("Model", "Camera").flatMap(([id, { node }]) => {
    const properties = scene.below(id, "NodeAttribute", "Camera")[0]?.[1].properties;
    return properties && numberIn(properties, "CameraProjectionType", 0) === 0 ? [{ id, properties, name: String(node.values[1]).split("\0")[0] }] : [];
  });
  const camera = found.find(({ name }) => name === wanted) ?? found[0];
  if (!camera) return null;
  const world = scene.world(camera.id);
  const column = (/** @type {number} */ first, sign = 1) => /** @type {import("./shapes.js").Vec3} */ ([0, 1, 2].map((i) => sign * (world[first + i] ?? 0)));
  const fov = fieldOfView(camera.properties);
  return orbitView(column(12), column(0, -1), column(4), fov, low, high); // cameras look along +X
}

/** How the picture's window fits the film: the film's width or height is kept, or the one that shows less or more. */
const FITS = { vertical: 1, horizontal: 2, fill: 3, overscan: 4 };
/** What states a camera's field of view. */
const APERTURES = { both: 0, horizontal: 1, vertical: 2, focalLength: 3 };

/** Returns a camera's vertical field of view in degrees, as ufbx does. @param {Properties} properties */
function fieldOfView(properties) {
  const at = (/** @type {string} */ name, otherwise = 0) => numberIn(properties, name, otherwise);
  const aspect = at("AspectWidth") / at("AspectHeight") || 4 / 3;
  let [wide, tall] = [at("FilmWidth", 0.816), at("FilmHeight", 0.612)]; // inches
  const fit = at("GateFit");
  const isWider = wide / tall > aspect;
  if (fit === FITS.horizontal || (fit === FITS.fill && !isWider) || (fit === FITS.overscan && isWider)) tall = wide / aspect;
  else if (fit) wide = tall * aspect;
  const mode = at("ApertureMode", APERTURES.vertical);
  const degrees = (/** @type {number} */ tangent) => (360 / Math.PI) * Math.atan(tangent);
  if (mode === APERTURES.focalLength) return degrees((tall * INCH) / 2 / (at("FocalLength") || 35));
  if (mode === APERTURES.horizontal) return degrees((Math.tan((at("FieldOfView", 40) * Math.PI) / 360) * tall) / wide);
  return mode === APERTURES.both ? at("FieldOfViewY", 40) : at("FieldOfView", 40);
}
