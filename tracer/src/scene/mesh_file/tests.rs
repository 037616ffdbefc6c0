use std::fs;

use glam::{Vec2, Vec3};

use super::*;

fn loaded(name: &str, bytes: &[u8]) -> Result<Mesh, String> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    fs::write(&path, bytes).unwrap();
    let why = |error: Error| error.to_string().rsplit_once("/").unwrap().1.to_owned();
    Mesh::load(&path).map_err(why)
}

fn tetrahedron() -> Mesh {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.1, 0.2, 1.0 / 3.0)];
    Mesh::new(positions, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
}

#[test]
fn what_is_saved_is_loaded_bit_by_bit() {
    let normals = vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(0.3, -1.0, 2.0)];
    for mesh in [tetrahedron(), tetrahedron().normals(normals)] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("mesh.PLY");
        mesh.save_ply(&path).unwrap();
        assert_eq!(Mesh::load(&path).unwrap(), mesh);
    }
}

#[test]
fn obj_files_of_all_kinds_of_corners_are_read() {
    let plain = "# a square\nmtllib none.mtl\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0\r\nv 0 1e0 0\ns off\n\
                 f 1 2 3 4\nf -4/1 -3/2 -1/3\n";
    let mesh = loaded("a.obj", plain.as_bytes()).unwrap();
    assert_eq!(
        mesh.positions,
        [Vec3::ZERO, Vec3::X, Vec3::ONE.with_z(0.0), Vec3::Y]
    );
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 3]]);
    let smooth =
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0 1 0\nf 1//1 2//1 3//1\nf 1//2 3//1 2/7/1\n";
    let mesh = loaded("b.obj", smooth.as_bytes()).unwrap();
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ZERO]);
    assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::Y]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [3, 2, 1]]);
}

#[test]
fn texture_coordinates_of_obj_files_begin_at_the_lower_left() {
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0.25 0\nvt 0.5\n";
    let read = |faces: &str| loaded("a.obj", format!("{corners}{faces}").as_bytes()).unwrap();
    let mesh = read("f 1/1 2/2 3/3\nf 3/-3 2/2 1/1\n");
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Y]);
    let [origin, right, middle] = [(0.0, 1.0), (1.0, 0.75), (0.5, 1.0)].map(Vec2::from);
    assert_eq!(mesh.uvs, [origin, right, middle, origin]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [3, 1, 0]]);
    assert!(mesh.normals.is_empty());
    let smooth = read("vn 0 0 1\nf 1/1/1 2/2/1 3/3/1\n");
    assert_eq!((smooth.uvs.len(), smooth.normals.len()), (3, 3));
    // If a corner has none, or refers to one that does not exist, the mesh has none.
    for faces in ["f 1/1 2/2 3\n", "f 1 2/2 3/3\n", "f 1/1 2/2 3/9\n"] {
        let mesh = read(faces);
        assert!(mesh.uvs.is_empty());
        assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    }
    let why = loaded("a.obj", b"vt x 0\n").unwrap_err().to_string();
    assert!(why.contains("line 1: `x` is not a number"), "{why}");
}

const ASCII: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty double x\n\
    property float y\nproperty float z\nproperty uchar red\nelement face 1\n\
    property list uchar int vertex_index\nproperty int flags\nend_header\n\
    0 0 0 255\n1 0 0 255\n1 1 0 255\n0 1 0 255\n4 0 1 2 3 7\n";

#[test]
fn ply_files_of_all_encodings_are_read() {
    let expected = Mesh::new(
        vec![Vec3::ZERO, Vec3::X, Vec3::ONE.with_z(0.0), Vec3::Y],
        vec![[0, 1, 2], [0, 2, 3]],
    );
    assert_eq!(loaded("a.ply", ASCII.as_bytes()).unwrap(), expected);
    let (header, _) = ASCII.split_once("end_header\n").unwrap();
    let header = header.replace("ascii", "binary_big_endian") + "end_header\n";
    let mut bytes = header.into_bytes();
    for [x, y] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0f32]] {
        bytes.extend(f64::from(x).to_be_bytes());
        bytes.extend([y, 0.0].into_iter().flat_map(f32::to_be_bytes));
        bytes.push(255);
    }
    bytes.push(4);
    bytes.extend([0, 1, 2, 3, 7].into_iter().flat_map(i32::to_be_bytes));
    assert_eq!(loaded("b.ply", &bytes).unwrap(), expected);
    for end in 1..bytes.len() {
        assert!(
            loaded("c.ply", &bytes[..end]).is_err() || end + 4 > bytes.len(),
            "{end}"
        );
    }
}

#[test]
fn other_lists_of_ply_files_are_skipped() {
    let file = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n\
                end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 0.5 -1 0 1.5\n";
    assert_eq!(
        loaded("a.ply", file.as_bytes()).unwrap().triangles,
        [[0, 1, 2]]
    );
    let wrong = file.replace("3 0 1 2", "3 0 1 0.5");
    let why = loaded("b.ply", wrong.as_bytes()).unwrap_err();
    assert!(why.contains("0.5 is not the number of a vertex"), "{why}");
}

#[test]
fn ply_colours_are_those_of_a_display() {
    let colored = ASCII.replace(
        "property uchar red\n",
        "property uchar red\nproperty ushort green\nproperty float blue\nproperty uchar alpha\n",
    );
    let text = colored
        .replace("0 0 0 255", "0 0 0 255 0 0.5 51")
        .replace("1 0 0 255", "1 0 0 0 65535 0 255")
        .replace("1 1 0 255", "1 1 0 0 0 1 255")
        .replace("0 1 0 255", "0 1 0 10 0 0 255");
    let mesh = loaded("a.ply", text.as_bytes()).unwrap();
    let expected = [
        [1.0, 0.0, 0.214_041, 0.2],
        [0.0, 1.0, 0.0, 1.0],
        [0.0, 0.0, 1.0, 1.0],
        [10.0 / 255.0 / 12.92, 0.0, 0.0, 1.0],
    ];
    assert_eq!(mesh.colors.len(), 4);
    for (color, expected) in mesh.colors.iter().zip(expected) {
        let off = (*color - glam::Vec4::from(expected)).abs().max_element();
        assert!(off < 1e-5, "{:?}", mesh.colors);
    }
    // A single channel is not a colour.
    assert!(loaded("b.ply", ASCII.as_bytes()).unwrap().colors.is_empty());
    let bright = text.replace("0 0 0 255 0 0.5 51", "0 0 0 255 0 1.5 51");
    let why = loaded("c.ply", bright.as_bytes()).unwrap_err().to_string();
    assert!(
        why.contains("c.ply: vertex 0: its blue is 1.5: it must be from 0 to 1"),
        "{why}"
    );
}

#[test]
#[expect(clippy::too_many_lines, reason = "files as data")]
fn bad_files_are_refused_with_file_place_and_value() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let obj = |end: &str| loaded("a.obj", format!("{triangle}{end}").as_bytes()).unwrap_err();
    let ply = |from: &str, to: &str| {
        assert!(ASCII.contains(from), "{from}");
        loaded("a.ply", ASCII.replacen(from, to, 1).as_bytes()).unwrap_err()
    };
    let cases = [
        (obj(""), "a.obj: it has no face"),
        (
            obj("v 1 nan 2"),
            "a.obj: line 4: the position [1, NaN, 2] is not finite",
        ),
        (obj("v 1 two 3"), "a.obj: line 4: `two` is not a number"),
        (obj("v 1"), "line 4: three numbers must follow"),
        (
            obj("f 1 2 4"),
            "line 4: 4 is not among the 3 positions so far",
        ),
        (
            obj("f 1 2 0"),
            "line 4: 0 is not among the 3 positions so far",
        ),
        (
            obj("f -4 2 1"),
            "line 4: -4 is not among the 3 positions so far",
        ),
        (
            obj("f 1 2"),
            "line 4: a face has 2 corners: it must have at least 3",
        ),
        (obj("f"), "line 4: a face has no corner"),
        (
            obj("f 1//1 2 3"),
            "line 4: 1 is not among the 0 normals so far",
        ),
        (
            obj("vn 0 0 1\nf 1//1 2 3"),
            "line 5: the corner `2` differs from those before it",
        ),
        (
            obj("surf 0 1"),
            "line 4: `surf` is not a statement that is known here",
        ),
        (
            ply("ply\n", "obj\n"),
            "a.ply: line 1: it does not begin with `ply`",
        ),
        (
            ply("ascii", "ebcdic"),
            "line 2: the format `ebcdic` is not known",
        ),
        (
            ply("vertex 4", "vertex four"),
            "line 4: `four` is not a count",
        ),
        (
            ply("double", "quad"),
            "line 5: the type `quad` is not known",
        ),
        (
            ply("end_header", "the_end"),
            "line 12: `the_end` is not known in a header",
        ),
        (
            ply("1 1 0 255", "1 inf 0 255"),
            "vertex 2: the position [1, inf, 0] is not finite",
        ),
        (
            ply("property double x\n", "property double w\n"),
            "vertex 0: the position [NaN, 0, 0]",
        ),
        (
            ply("4 0 1 2 3 7", "4 0 1 2 9 7"),
            "a face has vertex 9, but there are 4",
        ),
        (
            ply("4 0 1 2 3 7", "4 0 1 -2 3 7"),
            "face 0: -2 is not the number of a vertex",
        ),
        (
            ply("4 0 1 2 3 7", "2 0 1 7"),
            "face 0: a face has 2 corners",
        ),
        (
            ply("4 0 1 2 3 7", "4 0 1"),
            "face 0: the file ends within it",
        ),
        (ply("4 0 1 2 3 7", "999999 0 1"), "face 0: a list of 999999"),
        (
            loaded("a.stl", b"").unwrap_err(),
            "a.stl: its name must end with .obj or .ply",
        ),
        (
            loaded("a.ply", b"").unwrap_err(),
            "line 1: the header ends without `end_header`",
        ),
    ];
    for (refusal, sentence) in cases {
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
    }
    let absent = Mesh::load("absent.obj").unwrap_err();
    assert!(matches!(absent, Error::Io { .. }), "{absent}");
}
