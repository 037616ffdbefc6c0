//! Errors of the tracer, each of which says whose fault it is.

use std::path::PathBuf;

use glam::{Quat, Vec2, Vec3, Vec4};

use crate::text::{SENTENCE_BYTES_MAX, printable};
use crate::{ImageSize, Tile};

/// Each variant says who is at fault; the scene's author for all but [`Error::Device`] and
/// [`Error::Io`].
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene breaks a rule or a limit.
    #[error("the scene cannot be drawn: {}", sentence(.0))]
    InvalidScene(SceneError),
    /// A frame's update does not fit its scene.
    #[error("the scene update does not fit: {}", sentence(.0))]
    InvalidUpdate(SceneError),
    /// The settings or the image size are out of range.
    #[error("{0}")]
    InvalidSettings(SettingsError),
    /// A file holds something else than its format asks for.
    #[error("{path}: {message}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        message: String,
    },
    /// The operating system refused a file.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Its reason.
        source: std::io::Error,
    },
    /// The device cannot do the work: absent, lost, out of memory or wrong.
    #[error("{device}: {message}")]
    Device {
        /// The adapter, or the kind of device that was looked for.
        device: String,
        /// What happened and what to do.
        message: String,
    },
}

/// Names in a scene are a stranger's.
fn sentence(fault: &SceneError) -> String {
    printable(&fault.to_string(), SENTENCE_BYTES_MAX)
}

/// The rule that a scene, or an update of one, breaks.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// An object is at fault.
    #[error("object {index} `{name}`: {fault}")]
    Object {
        /// Index into the scene's objects.
        index: usize,
        /// Its name.
        name: String,
        /// Its fault.
        fault: Box<SceneError>,
    },
    /// A material is at fault.
    #[error("material `{name}`: {fault}")]
    Material {
        /// Its name.
        name: String,
        /// Its fault.
        fault: Box<SceneError>,
    },
    /// An area light is at fault.
    #[error("area light {index} `{name}`: {fault}")]
    AreaLight {
        /// Index into the scene's area lights.
        index: usize,
        /// Its name.
        name: String,
        /// Its fault.
        fault: Box<SceneError>,
    },
    /// A light without extent is at fault.
    #[error("punctual light {index} `{name}`: {fault}")]
    PunctualLight {
        /// Index into the scene's punctual lights.
        index: usize,
        /// Its name.
        name: String,
        /// Its fault.
        fault: Box<SceneError>,
    },
    /// A subtraction from a box is at fault.
    #[error("subtraction {index}: {fault}")]
    Subtraction {
        /// Index into the box's subtractions.
        index: usize,
        /// Its fault.
        fault: Box<SceneError>,
    },
    /// A pose is at fault.
    #[error("pose of object {object}: {fault}")]
    Pose {
        /// Index into the scene's objects.
        object: u32,
        /// Its fault.
        fault: Box<SceneError>,
    },
    /// A cloud of particles is at fault.
    #[error("cloud {index} of particles: {fault}")]
    Cloud {
        /// Index into the update's particles.
        index: usize,
        /// Its fault.
        fault: Box<SceneError>,
    },
    /// Particles are of a material with a pattern.
    #[error("its material has a pattern, which only objects can have: give it a plain one")]
    PatternedParticles,
    /// Particles are balls of a material with transmission.
    #[error(
        "its material has transmission, which makes it a thin wall, but its particles are balls: make it a dielectric"
    )]
    ThinWallParticles,
    /// The box of a cloud is too large for the smoothing radius of its surface.
    #[error(
        "an edge of its box is {edge_m} m, but its smoothing radius {smoothing_m} m: the edge may be at most {max} times \
         that"
    )]
    SurfaceBox {
        /// The longest edge, metres.
        edge_m: f32,
        /// The smoothing radius, metres.
        smoothing_m: f32,
        /// The most that the first may be over the second.
        max: f32,
    },
    /// Particles of a surface are too far apart.
    #[error(
        "its particles are so far apart that their surface takes more than {max} blocks of its grid, at most {max} are \
         allowed: draw them as balls, or raise the smoothing radius"
    )]
    SurfaceBlocks {
        /// The most blocks that are allowed.
        max: usize,
    },
    /// There is more of something than is allowed.
    #[error("it has {count} {what}: at most {max} are allowed")]
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// How much there is.
        count: usize,
        /// How much may be.
        max: usize,
    },
    /// A name is too long.
    #[error("a name that begins `{start}` has {bytes} bytes: at most {max} are allowed")]
    LongName {
        /// Its first characters.
        start: String,
        /// Its length.
        bytes: usize,
        /// The longest that is allowed.
        max: usize,
    },
    /// A number is out of range.
    #[error("{what} is {value}: it must be from {min} to {max}{unit}")]
    OutOfRange {
        /// The number.
        what: &'static str,
        /// Its value.
        value: f32,
        /// The least that is allowed.
        min: f32,
        /// The most that is allowed.
        max: f32,
        /// The unit, after a space; empty for none.
        unit: &'static str,
    },
    /// A length is out of range.
    #[error("{what} is {metres} m: it must be from {min:e} to {max:e} m")]
    Length {
        /// The length.
        what: &'static str,
        /// Its value.
        metres: f32,
        /// The least that is allowed.
        min: f32,
        /// The most that is allowed.
        max: f32,
    },
    /// A stripe's half width is out of range.
    #[error("its stripe's half_width is {0}: it must be above 0 and at most 1")]
    StripeWidth(f32),
    /// A ball's number is out of range.
    #[error("its number is {0}: it must be from 0 to 99")]
    BallNumber(u8),
    /// A channel is out of range.
    #[error("{what} is {value}: each channel must be from 0 to {max}")]
    Channels {
        /// The triple.
        what: &'static str,
        /// Its value.
        value: Vec3,
        /// The most that is allowed.
        max: f32,
    },
    /// A radiance is out of range.
    #[error("the {what}'s radiance is {value}: each channel must be from 0 to {max:e}")]
    Radiance {
        /// What emits it.
        what: &'static str,
        /// Its value.
        value: Vec3,
        /// The most that is allowed.
        max: f32,
    },
    /// A metal's index of refraction is out of range.
    #[error("its eta is {value}: each channel must be above 0 and at most {max}")]
    Eta {
        /// Its value.
        value: Vec3,
        /// The most that is allowed.
        max: f32,
    },
    /// A medium's extinction is out of range.
    #[error("its medium's extinction is {value}: each channel must be from 0 to {max:e} per metre")]
    Extinction {
        /// Its value, m⁻¹.
        value: Vec3,
        /// The most that is allowed.
        max: f32,
    },
    /// The extinctions of a scattering medium's channels are too different.
    #[error(
        "its medium's extinction is {value}: where it scatters, each channel must be above 0 and \
         none more than {ratio_max} times another"
    )]
    ExtinctionRatio {
        /// Its value, m⁻¹.
        value: Vec3,
        /// The largest ratio that is allowed.
        ratio_max: f32,
    },
    /// A position is too far away or no number.
    #[error("{what} is {value}: each coordinate must be within ±{max:e} m")]
    Position {
        /// The position.
        what: &'static str,
        /// Its value.
        value: Vec3,
        /// The largest coordinate that is allowed.
        max: f32,
    },
    /// A vector has a component that is infinite or no number.
    #[error("{what} is {value}: it must be finite")]
    NotFinite {
        /// The vector.
        what: &'static str,
        /// Its value.
        value: Vec3,
    },
    /// A normal is 0.
    #[error("its normal {0} must not be 0")]
    ZeroNormal(Vec3),
    /// A box has no extent along an axis.
    #[error("its min {min} must be below its max {max} on each axis")]
    Corners {
        /// Corner of the smallest coordinates.
        min: Vec3,
        /// Corner of the largest.
        max: Vec3,
    },
    /// A mesh has nothing to see.
    #[error("its mesh has {0} vertices and no triangle: give it one")]
    NoTriangles(usize),
    /// A vertex of a mesh is too far away or no number.
    #[error(
        "vertex {index} of its mesh is {value}: every coordinate in the world must be within ±{max:e} m"
    )]
    Vertex {
        /// Index into the mesh's positions.
        index: usize,
        /// Its value.
        value: Vec3,
        /// The largest coordinate that is allowed.
        max: f32,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} of its mesh has vertex {vertex}, but there are {vertices} vertices"
    )]
    VertexIndex {
        /// Index into the mesh's triangles.
        triangle: usize,
        /// Index of the vertex.
        vertex: u32,
        /// Vertices of the mesh.
        vertices: usize,
    },
    /// A mesh has another number of normals than of vertices.
    #[error("its mesh has {normals} normals for {vertices} vertices: give it one each, or none")]
    VertexNormals {
        /// Normals of the mesh.
        normals: usize,
        /// Vertices of the mesh.
        vertices: usize,
    },
    /// A vertex normal is no direction.
    #[error("normal {index} of its mesh is {value}: it must be finite and not 0")]
    VertexNormal {
        /// Index into the mesh's normals.
        index: usize,
        /// Its value.
        value: Vec3,
    },
    /// A mesh has another number of texture coordinates than of vertices.
    #[error(
        "its mesh has {uvs} texture coordinates for {vertices} vertices: give it one each, or none"
    )]
    TextureCoordinates {
        /// Texture coordinates of the mesh.
        uvs: usize,
        /// Vertices of the mesh.
        vertices: usize,
    },
    /// A texture coordinate is too large or no number.
    #[error("texture coordinate {index} of its mesh is {value}: each must be within ±{max}")]
    TextureCoordinate {
        /// Index into the mesh's texture coordinates.
        index: usize,
        /// Its value.
        value: Vec2,
        /// The largest that is allowed.
        max: f32,
    },
    /// A texture cannot be read.
    #[error("texture {index} `{name}`: {fault}")]
    Texture {
        /// Index into the scene's textures.
        index: usize,
        /// Its name.
        name: String,
        /// Why not.
        fault: String,
    },
    /// Text or bytes are no glTF that can be drawn.
    #[error("{0}")]
    Gltf(String),
    /// An environment map cannot be read.
    #[error("the environment map: {0}")]
    EnvironmentMap(String),
    /// Textures take too much memory.
    #[error("its textures take {bytes} bytes once decoded: at most {max} are allowed")]
    TextureBytes {
        /// What they take.
        bytes: u64,
        /// The most that is allowed.
        max: u64,
    },
    /// A material has a texture that does not exist.
    #[error("its texture {index} is not among the scene's {count}")]
    UnknownTexture {
        /// Index of the texture.
        index: u32,
        /// Textures of the scene.
        count: usize,
    },
    /// A textured material is on a surface without texture coordinates.
    #[error("its material `{0}` has textures, which need a mesh with texture coordinates")]
    TexturedShape(String),
    /// A material through which rays pass is on another shape than a mesh.
    #[error("its material `{0}` is not opaque, which only meshes can be of")]
    TransparentShape(String),
    /// A material with transmission is on a shape that has an inside.
    #[error(
        "its material `{0}` has transmission, which makes it a thin wall: give it to a mesh, a disc or a rectangle, or make \
         it a dielectric"
    )]
    ThinWallShape(String),
    /// A mesh has another number of vertex colours than of vertices.
    #[error("its mesh has {colors} colours for {vertices} vertices: give it one each, or none")]
    VertexColors {
        /// Colours of the mesh.
        colors: usize,
        /// Vertices of the mesh.
        vertices: usize,
    },
    /// A vertex colour is out of range or no number.
    #[error("colour {index} of its mesh is {value}: each number must be from 0 to 1")]
    VertexColor {
        /// Index into the mesh's colours.
        index: usize,
        /// Its value.
        value: Vec4,
    },
    /// A rectangle's edges are not at right angles.
    #[error("its half_u {half_u} and half_v {half_v} must be at right angles")]
    Skew {
        /// Half an edge.
        half_u: Vec3,
        /// Half the other edge.
        half_v: Vec3,
    },
    /// A rotation is no unit quaternion.
    #[error("its rotation is {0}: it must be a quaternion of length 1")]
    Rotation(Quat),
    /// The camera looks at its own eye.
    #[error("the camera's eye and target are both {0}")]
    CameraTarget(Vec3),
    /// The camera's up gives no upright direction.
    #[error("the camera's up {up} must not be 0 or parallel to its view {view}")]
    CameraUp {
        /// Its value.
        up: Vec3,
        /// From the eye to the target.
        view: Vec3,
    },
    /// A material is not among the scene's.
    #[error("its material `{0}` is not among the scene's materials")]
    UnknownMaterial(String),
    /// A surface without an inside is of a dielectric.
    #[error("its material `{0}` is a dielectric, which needs an inside")]
    DielectricSurface(String),
    /// A flat shape is of a dielectric.
    #[error(
        "its material `{0}` is a dielectric, which needs an inside: give it to a sphere or a box"
    )]
    DielectricFlat(String),
    /// A mesh of a dielectric is not closed, or its triangles do not go round the same way.
    #[error(
        "its material is a dielectric, so its mesh must be closed, but of the edge from {from} to {to} of triangle \
         {triangle} there are {along} that way and {against} the other way: there must be one of each"
    )]
    OpenMesh {
        /// Index into the mesh's triangles of the first that has such an edge.
        triangle: usize,
        /// Where the edge begins, in the mesh's own frame.
        from: Vec3,
        /// Where it ends.
        to: Vec3,
        /// How many triangles have it in this direction.
        along: usize,
        /// How many have it in the other.
        against: usize,
    },
    /// The triangles of a mesh of a dielectric go round clockwise as seen from outside.
    #[error(
        "its material is a dielectric, but its mesh is inside out: let its triangles go round counterclockwise as seen \
         from outside"
    )]
    InwardMesh,
    /// A compiled surface names a material that does not exist.
    #[error("a surface has material {material}, but there are {count}")]
    MaterialIndex {
        /// Index of the material.
        material: u32,
        /// Materials of the scene.
        count: usize,
    },
    /// An object has two poses.
    #[error("object {0} is posed twice")]
    PosedTwice(u32),
    /// A pose is of an object that cannot move.
    #[error("object {0} is posed, but only spheres, truncated cones and meshes move")]
    Immovable(u32),
    /// A pose is of an object that does not exist.
    #[error("object {object} is posed, but the scene has {count} objects")]
    UnknownObject {
        /// Index of the object.
        object: u32,
        /// Objects of the scene.
        count: usize,
    },
    /// There is nothing to see.
    #[error("it has 0 objects and 0 area lights: add at least one of either")]
    NoObjects,
    /// Nothing emits.
    #[error(
        "it has no light: the radiance of its sky is {sky} and none of its {lights} area lights \
         emits; brighten one of them"
    )]
    NoLight {
        /// Radiance of the environment.
        sky: Vec3,
        /// Area lights, none of which emits.
        lights: usize,
    },
    /// A handle belongs to another scene.
    #[error(
        "the handle of object {index} is of another scene than this one of {count} objects: use one \
         that this scene's `add` returned"
    )]
    ForeignHandle {
        /// Index of the object in its own scene.
        index: u32,
        /// Objects of this scene.
        count: usize,
    },
    /// A file's text is no scene.
    #[error("line {line}, column {column}: {message} ({advice})")]
    Syntax {
        /// Its place, from 1.
        line: usize,
        /// Its place, from 1.
        column: usize,
        /// The parser's reason.
        message: String,
        /// How to mend it.
        advice: &'static str,
    },
    /// A file is too long.
    #[error("it is longer than {0} bytes, the most that a scene file may hold: draw fewer objects")]
    LongFile(usize),
    /// A file is not UTF-8.
    #[error("line {line}: byte {byte} is not UTF-8: save the scene as UTF-8 text")]
    NotUtf8 {
        /// Line of the first wrong byte, from 1.
        line: usize,
        /// Its place in the file.
        byte: usize,
    },
}

/// What is wrong with settings, sizes or pictures that do not fit together.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// Too few or too many samples.
    #[error("{asked} samples per pixel are asked for: it must be from 1 to {max}")]
    Samples {
        /// How many are asked for.
        asked: u32,
        /// The most that is allowed.
        max: u32,
    },
    /// Paths too deep.
    #[error("a maximum depth of {asked} is asked for: at most {max} is allowed")]
    MaxDepth {
        /// What is asked for.
        asked: u32,
        /// The most that is allowed.
        max: u32,
    },
    /// No preset of that name.
    #[error("it must be one of {names}")]
    UnknownPreset {
        /// The names that there are.
        names: String,
    },
    /// Too small or too large an image.
    #[error("the image is {}x{} pixels: width and height must be from 1 to {max}", .size.width, .size.height)]
    ImageSize {
        /// What is asked for.
        size: ImageSize,
        /// The longest edge that is allowed.
        max: u32,
    },
    /// Text that is no image size.
    #[error("`{0}` is not WIDTHxHEIGHT in pixels, as in 1280x720")]
    ImageSizeText(String),
    /// A tile outside its image.
    #[error(
        "a tile of {}x{} pixels at ({}, {}) does not lie in an image of {}x{}",
        .tile.width, .tile.height, .tile.x, .tile.y, .size.width, .size.height
    )]
    TileOutsideImage {
        /// The tile.
        tile: Tile,
        /// The image's size.
        size: ImageSize,
    },
    /// A tile outside its film.
    #[error("{tile:?} does not lie in a film of {}x{} pixels", .size.width, .size.height)]
    TileOutsideFilm {
        /// The tile.
        tile: Tile,
        /// The film's size.
        size: ImageSize,
    },
    /// A tile with too few or too many pixels.
    #[error("{tile:?} comes with {pixels} pixels")]
    TilePixels {
        /// The tile.
        tile: Tile,
        /// Pixels that came with it.
        pixels: usize,
    },
    /// AOVs of another number of pixels than the picture's.
    #[error("{aovs} first hits are to be the layers of {pixels} pixels")]
    AovPixels {
        /// Pixels with AOVs.
        aovs: usize,
        /// Pixels of the picture.
        pixels: usize,
    },
    /// Pictures that are not of the size at which they are to be compared.
    #[error(
        "pictures of {test} and {reference} pixels cannot be compared as {}x{}: each must have {}, \
         and at least one",
        .size.width, .size.height, .size.pixels()
    )]
    ComparedPixels {
        /// Pixels of the tested picture.
        test: usize,
        /// Pixels of the reference.
        reference: usize,
        /// The size at which they are to be compared.
        size: ImageSize,
    },
    /// Pictures of different sizes.
    #[error(
        "pictures of {}x{} and {}x{} pixels cannot be compared: trace both at one size",
        .a.width, .a.height, .b.width, .b.height
    )]
    DifferentSizes {
        /// One size.
        a: ImageSize,
        /// The other.
        b: ImageSize,
    },
    /// Too few pictures for a standard error.
    #[error("a standard error needs at least two pictures")]
    TooFewPictures,
    /// An exposure that is not above 0.
    #[error("the exposure is {0}: it must be above 0")]
    Exposure(f32),
}
