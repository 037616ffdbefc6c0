//! A scene as flat plain-old-data arrays: the bytes that both back ends read.

use std::sync::OnceLock;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Quat, Vec3};

use crate::fresnel::internal_diffuse_reflectance;
use crate::reference::sheen::sheen_reflectance_max;
use crate::scene::validate::ALPHA_SMOOTH_MAX;
use crate::scene::{
    Camera, Cut, CutForm, Lamp, Material, Medium, ObjectPose, Paint, Scene, SceneUpdate, Shape,
};
use crate::tree::{Bounds, Tree};
use crate::{Error, ImageSize};

/// A validated scene, ready to trace. Primitives are sorted by shape; within a shape they keep
/// the order of [`Scene::objects`].
#[derive(Clone, Debug)]
pub struct CompiledScene {
    /// The camera that the next picture is taken with.
    pub camera: Camera,
    /// Radiance of rays that leave the scene.
    pub environment: Vec3,
    /// Balls.
    pub spheres: Vec<SphereData>,
    /// Axis-aligned boxes.
    pub boxes: Vec<BoxData>,
    /// Round plates.
    pub discs: Vec<DiscData>,
    /// Rectangles.
    pub rectangles: Vec<RectangleData>,
    /// Boxes from which parts are taken away.
    pub carved: Vec<CarvedData>,
    /// Surfaces of carved boxes: each one's box, then its cuts.
    pub faces: Vec<FaceData>,
    /// Emitting rectangles; rays end on them.
    pub lamps: Vec<LampData>,
    /// Materials; primitives hold indices.
    pub materials: Vec<MaterialData>,
    /// Per object of the scene: its shape's array and its place in it.
    pub primitives: Vec<Primitive>,
    /// When rays find primitives by a tree.
    pub hierarchy: Hierarchy,
    /// Of each shape as it is now, once somebody has asked for it.
    trees: [OnceLock<Option<Tree>>; ShapeKind::ALL.len()],
    /// The spheres as the scene has them: what an update starts from.
    spheres_at_rest: Vec<SphereData>,
    camera_at_rest: Camera,
}

/// When rays find primitives of a shape by a [`Tree`] instead of meeting each of them: pictures are the same
/// but where a ray that grazes a flat shape is rounded to its edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Hierarchy {
    /// Where that is faster: each back end knows from how many on.
    #[default]
    WhereFaster,
    /// Never.
    Never,
    /// Whenever there is a tree.
    Always,
}

/// A shape's array in the scene, in the order in which back ends number primitives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShapeKind {
    /// [`CompiledScene::spheres`].
    Sphere,
    /// [`CompiledScene::boxes`].
    Box,
    /// [`CompiledScene::discs`].
    Disc,
    /// [`CompiledScene::rectangles`].
    Rectangle,
    /// [`CompiledScene::faces`].
    Face,
}

impl ShapeKind {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Sphere,
        Self::Box,
        Self::Disc,
        Self::Rectangle,
        Self::Face,
    ];
}

/// Where an object's data lies, and what a ray hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Primitive {
    /// Index into [`CompiledScene::spheres`].
    Sphere(u32),
    /// Index into [`CompiledScene::boxes`].
    Box(u32),
    /// Index into [`CompiledScene::discs`].
    Disc(u32),
    /// Index into [`CompiledScene::rectangles`].
    Rectangle(u32),
    /// Index into [`CompiledScene::faces`]; for an object its first face.
    Face(u32),
    /// Index into [`CompiledScene::lamps`].
    Lamp(u32),
}

/// A ball. A radius of 0 hides it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SphereData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Radius, metres; 0 if hidden.
    pub radius: f32,
    /// Unit axis of the stripe in world space.
    pub stripe_axis: [f32; 3],
    /// Index of its material.
    pub material: u32,
    /// Unit axis through the circles of its number in world space.
    pub number_axis: [f32; 3],
    /// 1 if light that is scattered inside aims at lamps through the boundary
    /// ([`crate::reference::window`]), else 0: it is smooth, and all lamps look down on the whole ball
    /// from half a radius above or more, so that none is seen from inside, straight, that is not from
    /// where light leaves, or much larger.
    pub is_window: u32,
}

/// An axis-aligned box.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct BoxData {
    /// Smallest corner, metres.
    pub min: [f32; 3],
    /// Index of its material.
    pub material: u32,
    /// Largest corner, metres.
    pub max: [f32; 3],
    /// 0.
    pub padding: u32,
}

/// A box from which parts are taken away.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct CarvedData {
    /// Smallest corner, metres.
    pub min: [f32; 3],
    /// Index of its first face, that of the box itself; its cuts follow.
    pub first_face: u32,
    /// Largest corner, metres.
    pub max: [f32; 3],
    /// How many faces it has, the box's among them.
    pub face_count: u32,
}

/// [`FaceData::kind`] of a carved box itself: `a` and `b` are its corners.
pub const FACE_BOX: u32 = 0;
/// [`FaceData::kind`] of a plane: `a` is its normal out of the body, `b[0]` its distance from the
/// origin along it.
pub const FACE_PLANE: u32 = 1;
/// [`FaceData::kind`] of a bore: `a` is a point of its axis, `b[0]` its radius.
pub const FACE_BORE: u32 = 2;
/// [`FaceData::kind`] of a hollow: `a` and `b` are its corners.
pub const FACE_HOLLOW: u32 = 3;

/// [`FaceData::kind`] of a turned cut: `a` is its axis in x and y and the radius at z = 0, `b` is by
/// how much that grows with z, and the x and y from the axis to the plane that it begins beyond.
pub const FACE_TURNED: u32 = 4;

/// A surface of a carved box.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct FaceData {
    /// See the kinds.
    pub a: [f32; 3],
    /// [`FACE_BOX`], [`FACE_PLANE`], [`FACE_BORE`], [`FACE_HOLLOW`] or [`FACE_TURNED`].
    pub kind: u32,
    /// See the kinds.
    pub b: [f32; 3],
    /// Index of its material.
    pub material: u32,
}

/// A round plate.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct DiscData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Radius, metres.
    pub radius: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// Index of its material.
    pub material: u32,
}

/// A rectangle: `center + a·half_u + b·half_v`, `a, b ∈ [−1, 1]`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct RectangleData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Index of its material.
    pub material: u32,
    /// Half an edge, metres.
    pub half_u: [f32; 3],
    /// `1 / |half_u|²`.
    pub inv_u2: f32,
    /// Half the other edge, metres.
    pub half_v: [f32; 3],
    /// `1 / |half_v|²`.
    pub inv_v2: f32,
    /// Unit normal, along `half_u × half_v`.
    pub normal: [f32; 3],
    /// 0.
    pub padding: u32,
}

/// A lamp, as a rectangle that emits along its normal.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct LampData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Mean radiance over that of the scene's brightest lamp, 0 to 1.
    pub brightness: f32,
    /// Unit vector along an edge.
    pub axis_u: [f32; 3],
    /// Half that edge, metres.
    pub length_u: f32,
    /// Unit vector along the other edge.
    pub axis_v: [f32; 3],
    /// Half the other edge, metres.
    pub length_v: f32,
    /// Unit normal, the side that emits.
    pub normal: [f32; 3],
    /// 0.
    pub padding: u32,
    /// Radiance, W·sr⁻¹·m⁻².
    pub radiance: [f32; 3],
    /// 0.
    pub more_padding: u32,
}

impl LampData {
    /// Half of both edges: the lamp is `center + a·u + b·v`, `a, b ∈ [−1, 1]`.
    pub fn half_edges(&self) -> [[f32; 3]; 2] {
        let [u, v] = [(self.axis_u, self.length_u), (self.axis_v, self.length_v)];
        [u, v].map(|(axis, length)| axis.map(|c| c * length))
    }
}

/// [`MaterialData::kind`] of a diffuse surface, bare or coated.
pub const KIND_LAYERED: u32 = 0;
/// [`MaterialData::kind`] of a metal.
pub const KIND_CONDUCTOR: u32 = 1;
/// [`MaterialData::kind`] of a clear body.
pub const KIND_DIELECTRIC: u32 = 2;

/// [`MaterialData::pattern`] of plain and striped materials.
pub const PATTERN_NONE: u32 = 0;
/// [`MaterialData::pattern`] of numbered balls.
pub const PATTERN_NUMBER: u32 = 1;
/// [`MaterialData::pattern`] of wood.
pub const PATTERN_WOOD: u32 = 2;
/// [`MaterialData::pattern`] of planks.
pub const PATTERN_PLANKS: u32 = 3;

/// A material. Diffuse ones have `ior` 0 and `diffuse_scale` 1.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct MaterialData {
    /// Albedo.
    pub albedo: [f32; 3],
    /// Index of refraction of the coat or the body; 0 for none.
    pub ior: f32,
    /// Albedo inside the stripe.
    pub stripe_albedo: [f32; 3],
    /// The stripe is where `|n · stripe_axis|` is below this; 0 for none.
    pub stripe_half_width: f32,
    /// `1 / (η² (1 − F_dr,int))`.
    pub diffuse_scale: f32,
    /// [`KIND_LAYERED`], [`KIND_CONDUCTOR`] or [`KIND_DIELECTRIC`].
    pub kind: u32,
    /// GGX width α; 0 where smooth.
    pub alpha: f32,
    /// The rate of the exponential law that distances inside are drawn from, m⁻¹; 0 where nothing
    /// scatters.
    pub flight_rate: f32,
    /// Index of refraction of a metal, real part.
    pub eta: [f32; 3],
    /// [`PATTERN_NONE`], [`PATTERN_NUMBER`], [`PATTERN_WOOD`] or [`PATTERN_PLANKS`]. The rings of
    /// wood have the stripe's albedo.
    pub pattern: u32,
    /// Imaginary part.
    pub k: [f32; 3],
    /// A ball's number.
    pub number: u32,
    /// Extinction coefficient σt of the medium inside, m⁻¹.
    pub extinction: [f32; 3],
    /// The axis of wood's grain: 0, 1 or 2.
    pub grain_axis: u32,
    /// Scattering coefficient of the medium over `flight_rate`.
    pub scattering: [f32; 3],
    /// Width of a cloth's sheen.
    pub sheen_roughness: f32,
    /// Strength of a cloth's sheen, over 2π.
    pub sheen: [f32; 3],
    /// 0.
    pub padding0: u32,
    /// Spacing of sights, their x in end rails and y in side rails, metres; 0 for none.
    pub sights: [f32; 3],
    /// 0.
    pub padding1: u32,
}

/// A camera for one image size: the ray through film position `(x, y)`, in pixels from the top
/// left, leaves `eye` along `corner + x·dx + y·dy` (not of unit length).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct CameraFrame {
    /// The pinhole, metres.
    pub eye: [f32; 3],
    /// 0.
    pub padding0: u32,
    /// Direction of the film's top left corner.
    pub corner: [f32; 3],
    /// 0.
    pub padding1: u32,
    /// Step of one pixel to the right.
    pub dx: [f32; 3],
    /// 0.
    pub padding2: u32,
    /// Step of one pixel down.
    pub dy: [f32; 3],
    /// 0.
    pub padding3: u32,
}

impl CompiledScene {
    /// Checks `scene` against [`crate::scene::validate`] and lays it out.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] with the first rule that the scene breaks.
    pub fn new(scene: &Scene) -> Result<Self, Error> {
        scene.validate()?;
        let mut compiled = Self {
            camera: scene.camera,
            environment: scene.environment.radiance,
            spheres: Vec::new(),
            boxes: Vec::new(),
            discs: Vec::new(),
            rectangles: Vec::new(),
            carved: Vec::new(),
            faces: Vec::new(),
            lamps: lamps(&scene.lamps),
            materials: scene.materials.values().map(material_data).collect(),
            primitives: Vec::with_capacity(scene.objects.len()),
            hierarchy: Hierarchy::default(),
            trees: Default::default(),
            spheres_at_rest: Vec::new(),
            camera_at_rest: scene.camera,
        };
        let names: Vec<&str> = scene.materials.keys().map(String::as_str).collect();
        let material = |name: &str| {
            let place = names.binary_search(&name);
            place.expect("validated: each object's material exists") as u32
        };
        for object in &scene.objects {
            let primitive = compiled.push(&object.shape, material(&object.material), &material);
            compiled.primitives.push(primitive);
        }
        for index in 0..compiled.spheres.len() {
            compiled.spheres[index].is_window = compiled.is_window(index);
        }
        compiled.spheres_at_rest.clone_from(&compiled.spheres);
        Ok(compiled)
    }

    fn push(&mut self, shape: &Shape, material: u32, named: &dyn Fn(&str) -> u32) -> Primitive {
        match *shape {
            Shape::Sphere {
                center,
                radius,
                rotation,
            } => {
                self.spheres.push(SphereData {
                    center: center.to_array(),
                    radius,
                    stripe_axis: ball_axis(rotation, DVec3::Z),
                    material,
                    number_axis: ball_axis(rotation, DVec3::X),
                    is_window: 0,
                });
                Primitive::Sphere(self.spheres.len() as u32 - 1)
            }
            Shape::Box { min, max } => {
                let (min, max) = (min.to_array(), max.to_array());
                self.boxes.push(BoxData {
                    min,
                    material,
                    max,
                    padding: 0,
                });
                Primitive::Box(self.boxes.len() as u32 - 1)
            }
            Shape::Carved { min, max, ref cuts } => {
                self.push_carved([min, max], cuts, material, named)
            }
            Shape::Disc {
                center,
                normal,
                radius,
            } => {
                let (center, normal) = (center.to_array(), unit(normal.as_dvec3()).to_array());
                self.discs.push(DiscData {
                    center,
                    radius,
                    normal,
                    material,
                });
                Primitive::Disc(self.discs.len() as u32 - 1)
            }
            Shape::Rectangle {
                center,
                half_u,
                half_v,
            } => {
                self.rectangles.push(RectangleData {
                    center: center.to_array(),
                    material,
                    half_u: half_u.to_array(),
                    inv_u2: 1.0 / half_u.length_squared(),
                    half_v: half_v.to_array(),
                    inv_v2: 1.0 / half_v.length_squared(),
                    normal: unit(half_u.as_dvec3().cross(half_v.as_dvec3())).to_array(),
                    padding: 0,
                });
                Primitive::Rectangle(self.rectangles.len() as u32 - 1)
            }
        }
    }

    fn push_carved(
        &mut self,
        [min, max]: [Vec3; 2],
        cuts: &[Cut],
        material: u32,
        named: &dyn Fn(&str) -> u32,
    ) -> Primitive {
        let first_face = self.faces.len() as u32;
        let cut_faces = cuts.iter().map(|cut| {
            let material = cut.material.as_deref().map_or(material, named);
            cut_face(&cut.form, material)
        });
        let (min, max) = (min.to_array(), max.to_array());
        self.carved.push(CarvedData {
            min,
            first_face,
            max,
            face_count: 1 + cuts.len() as u32,
        });
        self.faces.push(FaceData {
            a: min,
            kind: FACE_BOX,
            b: max,
            material,
        });
        self.faces.extend(cut_faces);
        Primitive::Face(first_face)
    }

    /// Puts camera and objects where `update` wants them; what it does not name goes back to
    /// where the scene has it, so that updates may come in any order.
    ///
    /// # Errors
    /// [`Error::InvalidUpdate`] if a pose names no sphere of the scene, one that another pose has
    /// named, or holds a number that is not finite, or the camera is degenerate; the scene then is as if nothing had been applied.
    pub fn apply(&mut self, update: &SceneUpdate) -> Result<(), Error> {
        self.reset();
        let applied = self.try_apply(update);
        if applied.is_err() {
            self.reset();
        }
        applied
    }

    fn reset(&mut self) {
        self.spheres.clone_from(&self.spheres_at_rest);
        self.trees[ShapeKind::Sphere as usize] = OnceLock::new();
        self.camera = self.camera_at_rest;
    }

    fn try_apply(&mut self, update: &SceneUpdate) -> Result<(), Error> {
        if let Some(camera) = update.camera {
            camera.validate().map_err(Error::InvalidUpdate)?;
            self.camera = camera;
        }
        let mut posed_before = vec![false; self.spheres.len()];
        for pose in &update.poses {
            pose.validate().map_err(Error::InvalidUpdate)?;
            let sphere = self.movable_sphere(pose.object)?;
            if std::mem::replace(&mut posed_before[sphere], true) {
                return Err(Error::InvalidUpdate(format!(
                    "object {} is posed twice",
                    pose.object
                )));
            }
            self.spheres[sphere] = posed(self.spheres_at_rest[sphere], pose);
            self.spheres[sphere].is_window = self.is_window(sphere);
        }
        Ok(())
    }

    /// [`SphereData::is_window`].
    fn is_window(&self, sphere: usize) -> u32 {
        let sphere = &self.spheres[sphere];
        let material = &self.materials[sphere.material as usize];
        let center = Vec3::from_array(sphere.center);
        let mut heights = self.lamps.iter().map(|lamp| {
            let from_lamp = center - Vec3::from_array(lamp.center);
            from_lamp.dot(Vec3::from_array(lamp.normal))
        });
        u32::from(
            material.kind == KIND_DIELECTRIC
                && material.alpha == 0.0
                && material.flight_rate > 0.0
                && material.ior >= 1.0
                && sphere.radius > 0.0
                && heights.all(|height| height >= 1.5 * sphere.radius),
        )
    }

    fn movable_sphere(&self, object: u32) -> Result<usize, Error> {
        match self.primitives.get(object as usize) {
            Some(Primitive::Sphere(sphere)) => Ok(*sphere as usize),
            Some(_) => Err(Error::InvalidUpdate(format!(
                "object {object} is posed, but only spheres move and it is none"
            ))),
            None => Err(Error::InvalidUpdate(format!(
                "object {object} is posed, but the scene has {} objects",
                self.primitives.len()
            ))),
        }
    }

    /// How many primitives of a shape there are.
    pub fn count(&self, shape: ShapeKind) -> usize {
        match shape {
            ShapeKind::Sphere => self.spheres.len(),
            ShapeKind::Box => self.boxes.len(),
            ShapeKind::Disc => self.discs.len(),
            ShapeKind::Rectangle => self.rectangles.len(),
            ShapeKind::Face => self.faces.len(),
        }
    }

    /// The tree by which a back end finds the primitives of a shape that is faster so from `least` of them
    /// on; made when first asked for, that of balls again after [`CompiledScene::apply`]. None where rays
    /// are to meet each of them, and for the faces of carved boxes, which are few
    /// ([`crate::scene::validate::CUTS_TOTAL_MAX`]).
    pub fn tree(&self, shape: ShapeKind, least: usize) -> Option<&Tree> {
        let is_wanted = match self.hierarchy {
            Hierarchy::WhereFaster => self.count(shape) >= least,
            Hierarchy::Never => false,
            Hierarchy::Always => true,
        };
        let tree = || self.trees[shape as usize].get_or_init(|| self.grow(shape));
        is_wanted.then(tree)?.as_ref()
    }

    /// The tree of a shape's primitives, made anew; none if they are no more than a leaf.
    pub fn grow(&self, shape: ShapeKind) -> Option<Tree> {
        match shape {
            ShapeKind::Sphere => Tree::new(self.spheres.iter().map(Bounds::from)),
            ShapeKind::Box => Tree::new(self.boxes.iter().map(Bounds::from)),
            ShapeKind::Disc => Tree::new(self.discs.iter().map(Bounds::from)),
            ShapeKind::Rectangle => Tree::new(self.rectangles.iter().map(Bounds::from)),
            ShapeKind::Face => None,
        }
    }

    /// The material of a primitive; none for a lamp.
    pub fn material_of(&self, primitive: Primitive) -> Option<&MaterialData> {
        let material = match primitive {
            Primitive::Sphere(i) => self.spheres[i as usize].material,
            Primitive::Box(i) => self.boxes[i as usize].material,
            Primitive::Disc(i) => self.discs[i as usize].material,
            Primitive::Rectangle(i) => self.rectangles[i as usize].material,
            Primitive::Face(i) => self.faces[i as usize].material,
            Primitive::Lamp(_) => return None,
        };
        Some(&self.materials[material as usize])
    }

    /// The current camera's rays for an image of `size`.
    pub fn camera_frame(&self, size: ImageSize) -> CameraFrame {
        camera_frame(&self.camera, size)
    }
}

/// The camera's rays for an image of `size`, computed in f64 and rounded once.
pub fn camera_frame(camera: &Camera, size: ImageSize) -> CameraFrame {
    let (eye, target) = (camera.eye.as_dvec3(), camera.target.as_dvec3());
    let forward = (target - eye).normalize();
    let right = forward.cross(camera.up.as_dvec3()).normalize();
    let up = right.cross(forward);
    let half_width = (f64::from(camera.fov_x_deg).to_radians() * 0.5).tan();
    let pixel = 2.0 * half_width / f64::from(size.width);
    let corner = forward - right * half_width + up * (0.5 * pixel * f64::from(size.height));
    let array = |v: DVec3| v.as_vec3().to_array();
    CameraFrame {
        eye: camera.eye.to_array(),
        corner: array(corner),
        dx: array(right * pixel),
        dy: array(-up * pixel),
        ..CameraFrame::zeroed()
    }
}

fn posed(at_rest: SphereData, pose: &ObjectPose) -> SphereData {
    SphereData {
        center: pose.position.to_array(),
        radius: if pose.visible { at_rest.radius } else { 0.0 },
        stripe_axis: ball_axis(pose.rotation, DVec3::Z),
        material: at_rest.material,
        number_axis: ball_axis(pose.rotation, DVec3::X),
        is_window: 0,
    }
}

fn ball_axis(world_from_ball: Quat, axis: DVec3) -> [f32; 3] {
    unit(world_from_ball.as_dquat().normalize() * axis).to_array()
}

fn cut_face(form: &CutForm, material: u32) -> FaceData {
    let (kind, a, b) = match *form {
        CutForm::Beyond { point, normal } => {
            let n = normal.as_dvec3().normalize();
            let offset = n.dot(point.as_dvec3()) as f32;
            (FACE_PLANE, n.as_vec3(), Vec3::new(offset, 0.0, 0.0))
        }
        CutForm::Bore { center, radius } => (FACE_BORE, center, Vec3::new(radius, 0.0, 0.0)),
        CutForm::Hollow { min, max } => (FACE_HOLLOW, min, max),
        CutForm::Turned {
            center,
            radius,
            taper,
            beyond,
        } => (
            FACE_TURNED,
            Vec3::new(center.x, center.y, taper.mul_add(-center.z, radius)),
            Vec3::new(taper, beyond.x, beyond.y),
        ),
    };
    FaceData {
        a: a.to_array(),
        kind,
        b: b.to_array(),
        material,
    }
}

fn unit(v: DVec3) -> Vec3 {
    v.normalize().as_vec3()
}

fn lamps(lamps: &[Lamp]) -> Vec<LampData> {
    let mean = |lamp: &Lamp| lamp.radiance.as_dvec3().element_sum() / 3.0;
    let brightest = lamps.iter().map(mean).fold(f64::MIN_POSITIVE, f64::max);
    lamps
        .iter()
        .map(|lamp| lamp_data(lamp, (mean(lamp) / brightest) as f32))
        .collect()
}

fn lamp_data(lamp: &Lamp, brightness: f32) -> LampData {
    let [half_u, half_v] = [lamp.half_u, lamp.half_v].map(Vec3::as_dvec3);
    LampData {
        center: lamp.center.to_array(),
        brightness,
        axis_u: unit(half_u).to_array(),
        length_u: half_u.length() as f32,
        axis_v: unit(half_v).to_array(),
        length_v: half_v.length() as f32,
        normal: unit(half_u.cross(half_v)).to_array(),
        radiance: lamp.radiance.to_array(),
        ..LampData::zeroed()
    }
}

fn material_data(material: &Material) -> MaterialData {
    match *material {
        Material::Diffuse { albedo } => MaterialData {
            albedo: albedo.to_array(),
            diffuse_scale: 1.0,
            ..MaterialData::zeroed()
        },
        Material::SmoothPlastic {
            albedo,
            ior,
            internal_reflectance,
            stripe,
        } => {
            let eta = f64::from(ior);
            let internal =
                internal_reflectance.map_or_else(|| internal_diffuse_reflectance(eta), f64::from);
            MaterialData {
                albedo: albedo.to_array(),
                ior,
                stripe_albedo: stripe.map_or(Vec3::ZERO, |stripe| stripe.albedo).to_array(),
                stripe_half_width: stripe.map_or(0.0, |stripe| stripe.half_width),
                diffuse_scale: (1.0 / (eta * eta * (1.0 - internal))) as f32,
                ..MaterialData::zeroed()
            }
        }
        Material::Coated { ior, paint } => {
            let coat = Material::SmoothPlastic {
                albedo: Vec3::ZERO,
                ior,
                internal_reflectance: None,
                stripe: None,
            };
            painted(material_data(&coat), &paint)
        }
        Material::Cloth {
            albedo,
            sheen,
            sheen_roughness,
        } => {
            let most = sheen_reflectance_max(f64::from(sheen_roughness)) as f32;
            let left = 1.0 - sheen.max_element() * most;
            MaterialData {
                albedo: (albedo * left.max(0.0)).to_array(),
                diffuse_scale: 1.0,
                sheen: (sheen / (2.0 * std::f32::consts::PI)).to_array(),
                sheen_roughness,
                ..MaterialData::zeroed()
            }
        }
        Material::Conductor { eta, k, alpha } => MaterialData {
            kind: KIND_CONDUCTOR,
            alpha: rough_alpha(alpha),
            eta: eta.to_array(),
            k: k.to_array(),
            ..MaterialData::zeroed()
        },
        Material::Dielectric { ior, alpha, medium } => MaterialData {
            kind: KIND_DIELECTRIC,
            ior,
            alpha: rough_alpha(alpha),
            ..medium.map_or_else(MaterialData::zeroed, |medium| medium_data(&medium))
        },
    }
}

fn painted(coat: MaterialData, paint: &Paint) -> MaterialData {
    match *paint {
        Paint::Ball {
            albedo,
            stripe,
            number,
        } => MaterialData {
            albedo: albedo.to_array(),
            stripe_albedo: stripe.map_or(Vec3::ZERO, |stripe| stripe.albedo).to_array(),
            stripe_half_width: stripe.map_or(0.0, |stripe| stripe.half_width),
            pattern: if number > 0 {
                PATTERN_NUMBER
            } else {
                PATTERN_NONE
            },
            number: u32::from(number),
            ..coat
        },
        Paint::Wood {
            light,
            dark,
            grain,
            sights,
        } => MaterialData {
            albedo: light.to_array(),
            stripe_albedo: dark.to_array(),
            pattern: PATTERN_WOOD,
            grain_axis: grain as u32,
            sights: sights.map_or([0.0; 3], |s| [s.spacing, s.end_x, s.side_y]),
            ..coat
        },
        Paint::Planks { light, dark } => MaterialData {
            albedo: light.to_array(),
            stripe_albedo: dark.to_array(),
            pattern: PATTERN_PLANKS,
            ..coat
        },
    }
}

fn rough_alpha(alpha: f32) -> f32 {
    if alpha < ALPHA_SMOOTH_MAX { 0.0 } else { alpha }
}

/// Distances are drawn for the clearest channel, so that no channel's weight grows on the way.
fn medium_data(medium: &Medium) -> MaterialData {
    let Medium { extinction, albedo } = *medium;
    let data = MaterialData {
        extinction: extinction.to_array(),
        ..MaterialData::zeroed()
    };
    if albedo == Vec3::ZERO {
        return data;
    }
    let flight_rate = extinction.min_element();
    MaterialData {
        flight_rate,
        scattering: (albedo * extinction / flight_rate).to_array(),
        ..data
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Environment, Object};

    /// A box and two balls, so that an object's number differs from its sphere's.
    fn scene() -> Scene {
        let object = |name: &str, shape| Object {
            name: name.to_owned(),
            material: "grey".to_owned(),
            shape,
        };
        let ball = |x| Shape::Sphere {
            center: Vec3::new(x, 0.0, 0.0),
            radius: 0.5,
            rotation: Quat::IDENTITY,
        };
        let cube = Shape::Box {
            min: Vec3::NEG_ONE,
            max: Vec3::ONE,
        };
        Scene {
            camera: Camera {
                eye: Vec3::new(0.0, -5.0, 1.0),
                target: Vec3::ZERO,
                up: Vec3::Z,
                fov_x_deg: 60.0,
            },
            environment: Environment {
                radiance: Vec3::ONE,
            },
            materials: [(
                "grey".to_owned(),
                Material::Diffuse {
                    albedo: Vec3::splat(0.5),
                },
            )]
            .into(),
            objects: vec![
                object("first", ball(1.0)),
                object("cube", cube),
                object("second", ball(2.0)),
            ],
            lamps: Vec::new(),
        }
    }

    fn pose(object: u32, x: f32) -> ObjectPose {
        ObjectPose {
            object,
            position: Vec3::new(x, 0.0, 0.0),
            rotation: Quat::from_rotation_x(std::f32::consts::FRAC_PI_2),
            visible: true,
        }
    }

    fn poses(poses: &[ObjectPose]) -> SceneUpdate {
        SceneUpdate {
            camera: None,
            poses: poses.to_vec(),
        }
    }

    fn after(updates: &[SceneUpdate]) -> (Vec<SphereData>, Camera) {
        let mut compiled = CompiledScene::new(&scene()).unwrap();
        for update in updates {
            let _ = compiled.apply(update);
        }
        (compiled.spheres, compiled.camera)
    }

    #[test]
    fn objects_name_their_data() {
        let compiled = CompiledScene::new(&scene()).unwrap();
        let expected = [
            Primitive::Sphere(0),
            Primitive::Box(0),
            Primitive::Sphere(1),
        ];
        assert_eq!(compiled.primitives, expected);
        assert_eq!(compiled.spheres[1].center, [2.0, 0.0, 0.0]);
    }

    #[test]
    fn a_pose_moves_turns_and_hides_its_ball() {
        let hidden = ObjectPose {
            visible: false,
            ..pose(0, 7.0)
        };
        let (spheres, _) = after(&[poses(&[pose(2, 9.0), hidden])]);
        assert_eq!((spheres[0].center[0], spheres[0].radius), (7.0, 0.0));
        assert_eq!((spheres[1].center[0], spheres[1].radius), (9.0, 0.5));
        let axis = Vec3::from_array(spheres[1].stripe_axis);
        assert!((axis - Vec3::NEG_Y).length() < 1e-6, "{axis}");
    }

    #[test]
    fn updates_do_not_depend_on_those_before() {
        let (a, b) = (poses(&[pose(0, 7.0)]), poses(&[pose(2, 9.0)]));
        assert_eq!(
            after(&[a.clone(), b.clone()]),
            after(std::slice::from_ref(&b))
        );
        assert_eq!(after(&[b, a.clone()]), after(std::slice::from_ref(&a)));
        let still = CompiledScene::new(&scene()).unwrap();
        assert_eq!(
            after(&[a, SceneUpdate::default()]),
            (still.spheres, still.camera)
        );
        let swapped = [pose(2, 9.0), pose(0, 7.0)];
        assert_eq!(
            after(&[poses(&swapped)]),
            after(&[poses(&[swapped[1], swapped[0]])])
        );
    }

    #[test]
    fn a_refused_update_leaves_nothing_behind() {
        let untouched = after(&[]);
        let nan = ObjectPose {
            position: Vec3::NAN,
            ..pose(2, 0.0)
        };
        let turned = ObjectPose {
            rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 2.0),
            ..pose(2, 0.0)
        };
        let blind = Camera {
            fov_x_deg: f32::NAN,
            ..scene().camera
        };
        let good = pose(0, 7.0);
        for (update, sentence) in [
            (
                poses(&[good, nan]),
                "pose of object 2: its position is [NaN",
            ),
            (poses(&[good, turned]), "pose of object 2: its rotation is"),
            (
                poses(&[good, pose(1, 0.0)]),
                "object 1 is posed, but only spheres move",
            ),
            (
                poses(&[good, pose(3, 0.0)]),
                "object 3 is posed, but the scene has 3 objects",
            ),
            (
                poses(&[good, pose(2, 0.0), good]),
                "object 0 is posed twice",
            ),
            (
                SceneUpdate {
                    camera: Some(blind),
                    poses: vec![good],
                },
                "the camera's fov_x_deg is NaN",
            ),
        ] {
            let mut compiled = CompiledScene::new(&scene()).unwrap();
            compiled.apply(&poses(&[pose(2, 4.0)])).unwrap();
            let refusal = compiled.apply(&update).unwrap_err().to_string();
            assert!(
                refusal.contains(sentence),
                "`{sentence}` is not in `{refusal}`"
            );
            assert_eq!((compiled.spheres, compiled.camera), untouched);
        }
    }

    #[test]
    fn the_camera_s_corners_span_its_field_of_view() {
        let size = ImageSize::new(200, 100);
        let frame = camera_frame(&scene().camera, size);
        let at = |x: f32, y: f32| {
            Vec3::from(frame.corner) + x * Vec3::from(frame.dx) + y * Vec3::from(frame.dy)
        };
        let forward = Vec3::new(0.0, 5.0, -1.0).normalize();
        assert!((at(100.0, 50.0) - forward).length() < 1e-6);
        let across = at(0.0, 50.0).angle_between(at(200.0, 50.0));
        assert!((across.to_degrees() - 60.0).abs() < 1e-4, "{across}");
        assert!(at(200.0, 50.0).x > 0.0, "right is right");
        assert!(at(100.0, 0.0).z > at(100.0, 100.0).z, "row 0 is the top");
        let pixel = Vec3::from(frame.dx).length() / Vec3::from(frame.dy).length();
        assert!((pixel - 1.0).abs() < 1e-6, "pixels are square");
    }

    #[test]
    fn lamps_and_plates_face_along_u_cross_v() {
        let mut scene = scene();
        let (half_u, half_v) = (Vec3::new(0.0, 3.0, 0.0), Vec3::new(0.0, 0.0, 1e-3));
        scene.lamps.push(Lamp {
            name: String::new(),
            center: Vec3::ZERO,
            half_u,
            half_v,
            radiance: Vec3::ONE,
        });
        scene.objects[0].shape = Shape::Rectangle {
            center: Vec3::ZERO,
            half_u,
            half_v,
        };
        let compiled = CompiledScene::new(&scene).unwrap();
        assert_eq!(compiled.lamps[0].normal, [1.0, 0.0, 0.0]);
        assert_eq!(compiled.rectangles[0].normal, [1.0, 0.0, 0.0]);
        assert!((compiled.lamps[0].length_v / 1e-3 - 1.0).abs() < 1e-6);
    }
}
