//! Python module of Carom's render farm: takes scenes from dictionaries or files and returns NumPy arrays.
//!
//! `carom.pyi` documents the Python API. Nothing is computed here: arguments are checked and converted, and
//! while a picture is traced other Python threads run and Ctrl-C is handled.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use carom_farm::carom_tracer::tonemap::srgb8;
use carom_farm::carom_tracer::{Camera, Mesh, Object, Scene, Shape};
use carom_farm::glam::{Vec2, Vec3};
use carom_farm::{Error, Farm, FarmConfig, LocalNode, Picture, SceneFile, Still, open_scene};
use numpy::ndarray::ArrayView1;
use numpy::{
    Element, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3,
};
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

create_exception!(carom, FarmError, PyException);

/// Converts an error: invalid input becomes a `ValueError`, any other a `carom.FarmError`.
fn raised(error: Error) -> PyErr {
    match error.is_invalid_input() {
        true => PyValueError::new_err(error.to_string()),
        false => FarmError::new_err(error.to_string()),
    }
}

fn wrong(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A scene; see `carom.pyi`.
#[pyclass(name = "Scene", module = "carom")]
struct PyScene {
    scene: Scene,
}

#[pymethods]
impl PyScene {
    #[new]
    fn new(source: &Bound<'_, PyAny>) -> PyResult<Self> {
        scene_of(source, &Moment::default()).map(|scene| Self { scene })
    }

    #[staticmethod]
    #[pyo3(signature = (path, *, time = None, animation = None))]
    fn load(
        py: Python<'_>,
        path: PathBuf,
        time: Option<f64>,
        animation: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let moment = Moment::new(time, animation)?;
        let scene = py.detach(|| moment.open(path)).map_err(raised)?;
        Ok(Self { scene })
    }

    fn save(&self, path: PathBuf) -> PyResult<()> {
        self.scene.save(path).map_err(wrong)
    }

    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let text = self.scene.to_json().map_err(wrong)?;
        py.import("json")?.call_method1("loads", (text,))
    }

    #[pyo3(signature = (eye, target, *, up = [0.0, 0.0, 1.0], fov_x_deg = 44.0))]
    fn look(&mut self, eye: [f32; 3], target: [f32; 3], up: [f32; 3], fov_x_deg: f32) {
        self.scene.camera = Camera {
            up: up.into(),
            fov_x_deg,
            ..Camera::looking_at(eye, target)
        };
    }

    #[pyo3(signature = (name, positions, triangles, material, *, normals = None, uvs = None))]
    fn add_mesh(
        &mut self,
        name: String,
        positions: &Bound<'_, PyAny>,
        triangles: &Bound<'_, PyAny>,
        material: String,
        normals: Option<&Bound<'_, PyAny>>,
        uvs: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let positions: Vec<Vec3> = rows::<f32, _, 3>(positions, "positions", FLOAT)?;
        let mut mesh = Mesh::new(positions, corners(triangles)?);
        if let Some(normals) = normals {
            mesh = mesh.normals(rows::<f32, Vec3, 3>(normals, "normals", FLOAT)?);
        }
        if let Some(uvs) = uvs {
            mesh = mesh.uvs(rows::<f32, Vec2, 2>(uvs, "uvs", FLOAT)?);
        }
        self.add(name, material, mesh)
    }

    fn add_mesh_file(&mut self, name: String, path: PathBuf, material: String) -> PyResult<()> {
        let mesh = Mesh::load(path).map_err(wrong)?;
        self.add(name, material, mesh)
    }

    fn __repr__(&self) -> String {
        let (objects, lights) = (self.scene.objects.len(), self.scene.area_lights.len());
        format!("<carom.Scene of {objects} objects and {lights} area lights>")
    }
}

impl PyScene {
    fn add(&mut self, name: String, material: String, mesh: Mesh) -> PyResult<()> {
        if !self.scene.materials.contains_key(&material) {
            let known: Vec<_> = self.scene.materials.keys().map(String::as_str).collect();
            let known = known.join(", ");
            return Err(wrong(format!(
                "there is no material `{material}`: there are {known}"
            )));
        }
        let shape = Shape::Mesh(mesh);
        self.scene.objects.push(Object {
            name,
            material,
            shape,
        });
        Ok(())
    }
}

/// Time in a scene file's animation; if both fields are `None`, the file is used without its animations.
#[derive(Default)]
struct Moment {
    secs: Option<f64>,
    animation: Option<String>,
}

impl Moment {
    /// The animation may be given by its name or number.
    fn new(secs: Option<f64>, animation: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let name = |animation: &Bound<'_, PyAny>| {
            if let Ok(name) = animation.extract::<String>() {
                return Ok(name);
            }
            let number = animation.extract::<usize>();
            number.map(|number| number.to_string()).map_err(|_| {
                PyTypeError::new_err("an animation is a name or a number, the first being 0")
            })
        };
        let animation = animation.map(name).transpose()?;
        Ok(Self { secs, animation })
    }

    fn is_given(&self) -> bool {
        self.secs.is_some() || self.animation.is_some()
    }

    fn open(&self, path: PathBuf) -> Result<Scene, Error> {
        if !self.is_given() {
            return open_scene(path);
        }
        let file = SceneFile::open(path)?;
        let animation = file.find_animation(self.animation.as_deref())?;
        file.scene_at(animation, self.secs.unwrap_or(0.0))
    }
}

/// A scene from a `carom.Scene`, a dictionary in the format of scene files, or the path of a scene file.
fn scene_of(source: &Bound<'_, PyAny>, moment: &Moment) -> PyResult<Scene> {
    if let Ok(path) = source.extract::<PathBuf>() {
        return source.py().detach(|| moment.open(path)).map_err(raised);
    }
    if moment.is_given() {
        return Err(wrong(
            "time and animation are of scene files: give the path of one, or use carom.Scene.load",
        ));
    }
    if let Ok(scene) = source.cast::<PyScene>() {
        return Ok(scene.borrow().scene.clone());
    }
    if source.is_instance_of::<PyDict>() {
        let py = source.py();
        let options = PyDict::new(py);
        options.set_item("allow_nan", false)?;
        // NumPy arrays and scalars are converted by their method `tolist`.
        let listed = py
            .import("operator")?
            .call_method1("methodcaller", ("tolist",))?;
        options.set_item("default", listed)?;
        let text = py
            .import("json")?
            .call_method("dumps", (source,), Some(&options))?;
        return Scene::from_json(&text.extract::<String>()?).map_err(wrong);
    }
    Err(PyTypeError::new_err(format!(
        "a scene is a carom.Scene, a dict or the path of a scene file, not {}",
        source.get_type().name()?
    )))
}

/// The rows of an n×`N` array of any type that NumPy converts to `kind`.
fn rows<T: Element + Copy, V: From<[T; N]>, const N: usize>(
    array: &Bound<'_, PyAny>,
    name: &str,
    kind: &str,
) -> PyResult<Vec<V>> {
    let refused = || wrong(format!("{name} must be an array of n times {N}"));
    let array = converted(array, Some(kind))?;
    let array: PyReadonlyArray2<'_, T> = array.extract().map_err(|_| refused())?;
    let rows = array.as_array();
    if rows.ncols() != N {
        return Err(refused());
    }
    let row = |row: ArrayView1<'_, T>| V::from(std::array::from_fn(|column| row[column]));
    Ok(rows.rows().into_iter().map(row).collect())
}

fn corners(array: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 3]>> {
    let numbers = converted(array, None)?.getattr("dtype")?;
    let kind: String = numbers.getattr("kind")?.extract()?;
    if kind != "i" && kind != "u" {
        return Err(wrong("triangles are whole numbers: indices into positions"));
    }
    let index = |value: i64| {
        u32::try_from(value).map_err(|_| wrong(format!("the triangles name position {value}")))
    };
    let row = |[a, b, c]: [i64; 3]| Ok([index(a)?, index(b)?, index(c)?]);
    let rows = rows(array, "triangles", "int64")?;
    rows.into_iter().map(row).collect()
}

/// A NumPy array of type `kind`, or of its own type without one.
fn converted<'py>(array: &Bound<'py, PyAny>, kind: Option<&str>) -> PyResult<Bound<'py, PyAny>> {
    let numpy = array.py().import("numpy")?;
    numpy.call_method1("asarray", (array, kind))
}

/// A render farm; see `carom.pyi`.
#[pyclass(name = "Farm", module = "carom")]
struct PyFarm {
    /// `None` once closed. Locked only to begin a render, so that threads can render concurrently.
    farm: Mutex<Option<Farm>>,
}

#[pymethods]
impl PyFarm {
    #[new]
    #[pyo3(signature = (nodes = None, *, backend = None, credentials = None, config = None, threads = None))]
    fn new(
        py: Python<'_>,
        nodes: Option<Vec<String>>,
        backend: Option<&str>,
        credentials: Option<PathBuf>,
        config: Option<PathBuf>,
        threads: Option<u16>,
    ) -> PyResult<Self> {
        let mut farm = match config {
            Some(path) => FarmConfig::load(path),
            None => FarmConfig::discover(),
        }
        .map_err(raised)?;
        farm.nodes = nodes.unwrap_or(farm.nodes);
        farm.credentials = credentials.unwrap_or(farm.credentials);
        farm.threads = threads.unwrap_or(farm.threads);
        if let Some(backend) = backend {
            farm.local = backend.parse::<LocalNode>().map_err(raised)?;
        }
        let farm = py.detach(|| Farm::new(farm)).map_err(raised)?;
        Ok(Self {
            farm: Mutex::new(Some(farm)),
        })
    }

    #[pyo3(signature = (scene, size, spp, *, seed = 0, max_depth = None, denoise = false, layers = false, progress = None, time = None, animation = None))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        scene: &Bound<'py, PyAny>,
        size: (u32, u32),
        spp: u32,
        seed: u32,
        max_depth: Option<u32>,
        denoise: bool,
        layers: bool,
        progress: Option<Bound<'py, PyAny>>,
        time: Option<f64>,
        animation: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let scene = scene_of(scene, &Moment::new(time, animation)?)?;
        let mut still = Still::new(size.0, size.1).samples(spp).seed(seed);
        if let Some(max_depth) = max_depth {
            still = still.max_depth(max_depth);
        }
        if denoise {
            still = still.denoise();
        }
        if layers {
            still = still.layers();
        }
        let begin = || {
            let mut farm = self.lock();
            farm.as_mut().map(|farm| farm.still(&scene, still))
        };
        let job = py
            .detach(begin)
            .ok_or_else(|| FarmError::new_err("the farm is closed"))?;
        let job = job.map_err(raised)?;
        let mut told = -1.0;
        let begun = Instant::now();
        while !job.is_finished() {
            // Proportional to the elapsed time, so that short renders are delayed by at most a twentieth.
            let pause = (begun.elapsed() / 20).clamp(POLL_MIN, POLL_MAX);
            py.detach(|| std::thread::sleep(pause));
            // An error drops the job, which cancels it.
            py.check_signals()?;
            let fraction = job.progress().fraction();
            if let (Some(progress), true) = (&progress, fraction > told) {
                told = fraction;
                progress.call1((fraction,))?;
            }
        }
        let picture = py.detach(|| job.wait()).map_err(raised)?;
        match layers {
            true => Ok(layers_of(py, &picture)?.into_any()),
            false => Ok(color(py, &picture)?.into_any()),
        }
    }

    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let nodes = PyList::empty(py);
        for status in self.lock().iter().flat_map(Farm::nodes) {
            let node = PyDict::new(py);
            node.set_item("address", &status.address)?;
            node.set_item("state", status.state.to_string())?;
            let device = status.info.as_ref().map(|info| info.device.name.as_str());
            node.set_item("device", device)?;
            node.set_item("msamples_per_sec", status.msamples_per_sec)?;
            node.set_item("tiles", status.tiles)?;
            nodes.append(node)?;
        }
        Ok(nodes)
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| drop(self.lock().take()));
    }

    fn __enter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __exit__(
        &self,
        py: Python<'_>,
        _kind: &Bound<'_, PyAny>,
        _error: &Bound<'_, PyAny>,
        _trace: &Bound<'_, PyAny>,
    ) {
        self.close(py);
    }
}

impl PyFarm {
    fn lock(&self) -> MutexGuard<'_, Option<Farm>> {
        self.farm.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn color<'py>(py: Python<'py>, picture: &Picture) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let image = picture.image();
    cube(py, picture, image.pixels.into_iter().flatten())
}

/// An array of height × width × 3 from the values of three channels, row by row.
fn cube<'py>(
    py: Python<'py>,
    picture: &Picture,
    values: impl Iterator<Item = f32>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let size = picture.size();
    let flat = PyArray1::from_vec(py, values.collect());
    flat.reshape([size.height as usize, size.width as usize, 3])
}

fn layers_of<'py>(py: Python<'py>, picture: &Picture) -> PyResult<Bound<'py, PyDict>> {
    let aovs = picture.layers();
    let dict = PyDict::new(py);
    dict.set_item("color", color(py, picture)?)?;
    let albedo = cube(py, picture, aovs.iter().flat_map(|aov| aov.albedo))?;
    dict.set_item("albedo", albedo)?;
    let normal = cube(py, picture, aovs.iter().flat_map(|aov| aov.normal))?;
    dict.set_item("normal", normal)?;
    let size = picture.size();
    let depth = aovs.iter().map(|aov| aov.inverse_depth.recip()).collect();
    let depth: Bound<'py, PyArray2<f32>> =
        PyArray1::from_vec(py, depth).reshape([size.height as usize, size.width as usize])?;
    dict.set_item("depth", depth)?;
    Ok(dict)
}

/// Radiance as 8-bit sRGB; see `carom.pyi`.
#[pyfunction]
#[pyo3(signature = (image, exposure = 1.0))]
fn srgb<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    exposure: f32,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let not_an_image = || wrong("an image is an array of height times width times 3");
    let image = converted(image, Some(FLOAT))?;
    let image: PyReadonlyArray3<'py, f32> = image.extract().map_err(|_| not_an_image())?;
    let image = image.as_array();
    let (height, width, channels) = image.dim();
    if channels != 3 {
        return Err(not_an_image());
    }
    let pixels = image.rows().into_iter();
    let bytes = pixels.flat_map(|pixel| srgb8([pixel[0], pixel[1], pixel[2]], exposure));
    PyArray1::from_vec(py, bytes.collect()).reshape([height, width, 3])
}

/// NumPy's name of `f32`.
const FLOAT: &str = "float32";
/// Bounds of the period in which a render checks for Ctrl-C and reports progress.
const POLL_MIN: Duration = Duration::from_micros(50);
const POLL_MAX: Duration = Duration::from_millis(20);

/// A path tracer over any mix of GPUs and CPUs.
#[pymodule]
fn carom(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("FarmError", module.py().get_type::<FarmError>())?;
    module.add_class::<PyFarm>()?;
    module.add_class::<PyScene>()?;
    module.add_function(wrap_pyfunction!(srgb, module)?)
}
