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
    // Where a corner has none, or names one that is not there, the mesh has none.
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
    // One channel alone is no colour.
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

const PAINT: &str = "# two\nnewmtl red\nKd 0.5 0.25 0.125\nKs 0.5 0.5 0.5\nNs 30\nKe 3 2 1\nd 0.5\nillum 2\n\n\
    newmtl worn\nmap_Kd -clamp on -s 1 1 1 maps\\wood.png\nmap_d maps/wood.png\nnorm -bm 0.5 maps/wood.png\n\
    Pr 0.25\nPm 1\nPc 0.5\nPcr 0.125\n";
const PAINTED: &str = "mtllib paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n\
    f 1 2 3\nusemtl red\nf 1 2 4\nusemtl worn\nf 1/1 3/2 4/3\nusemtl red\nf 2 3 4\n";

/// An OBJ file with its materials and a texture, in a folder of their own.
fn painted(obj: &str, mtl: &str) -> Result<ObjScene, Error> {
    use crate::texture_file::{Texels, encode_png};
    let folder = tempfile::tempdir().unwrap();
    let texels = vec![[200, 100, 50, 128]; 4];
    let size = [2, 2];
    std::fs::create_dir(folder.path().join("maps")).unwrap();
    let picture = encode_png(&Texels { size, texels }).unwrap();
    std::fs::write(folder.path().join("maps/wood.png"), picture).unwrap();
    std::fs::write(folder.path().join("maps/not.png"), "GIF89a").unwrap();
    std::fs::write(folder.path().join("paint.mtl"), mtl).unwrap();
    let path = folder.path().join("a.obj");
    std::fs::write(&path, obj).unwrap();
    ObjScene::load(path)
}

#[test]
fn materials_of_obj_files_are_read() {
    use crate::scene::{ColorSpace, Layers, Opacity, Scene, Wrap};
    let read = painted(PAINTED, PAINT).unwrap();
    let [bare, red, worn] = &read.parts[..] else {
        panic!("{} parts", read.parts.len());
    };
    assert_eq!((bare.material, bare.mesh.triangles.len()), (None, 1));
    assert_eq!((red.name.as_str(), red.mesh.triangles.len()), ("red", 2));
    assert_eq!(red.mesh.positions.len(), 4);
    let Some(Material::MetallicRoughness {
        base_color,
        metallic,
        roughness,
        emission,
        opacity,
        layers,
        ..
    }) = red.material
    else {
        panic!("{red:?}");
    };
    assert_eq!(base_color, Vec3::new(0.5, 0.25, 0.125));
    assert_eq!((metallic, roughness), (0.0, 0.5));
    assert_eq!(emission, Vec3::new(3.0, 2.0, 1.0));
    assert_eq!(opacity, Opacity::Blend { alpha: 0.5 });
    assert_eq!(
        layers,
        Layers {
            sheen_roughness: 0.5,
            ..Layers::NONE
        }
    );
    let Some(Material::MetallicRoughness {
        base_color,
        metallic,
        roughness,
        textures,
        opacity,
        layers,
        ..
    }) = worn.material
    else {
        panic!("{worn:?}");
    };
    assert_eq!((base_color, metallic, roughness), (Vec3::ONE, 1.0, 0.25));
    assert_eq!(opacity, Opacity::Blend { alpha: 1.0 });
    assert_eq!((layers.clearcoat, layers.clearcoat_roughness), (0.5, 0.125));
    assert_eq!(textures.normal_scale, 0.5);
    let color = &read.textures[textures.base_color.unwrap() as usize];
    assert_eq!(
        (color.color_space, color.wrap),
        (ColorSpace::Srgb, [Wrap::Clamp; 2])
    );
    let normal = &read.textures[textures.normal.unwrap() as usize];
    assert_eq!(
        (normal.color_space, normal.wrap),
        (ColorSpace::Linear, [Wrap::Repeat; 2])
    );
    let mut scene = Scene::new();
    scene.add_texture(color.clone());
    read.add_to(&mut scene, Material::grey(0.5));
    scene.validate().unwrap();
    let last = scene.materials[&scene.objects[2].material];
    assert_eq!(last.textures().base_color, Some(1));
    // As one mesh it has all faces and no materials.
    assert_eq!(
        loaded("a.obj", PAINTED.as_bytes()).unwrap().triangles.len(),
        4
    );
}

#[test]
#[expect(clippy::too_many_lines, reason = "files as data")]
fn faults_of_materials_are_sentences_with_file_line_and_value() {
    let obj = |from: &str, to: &str| painted(&PAINTED.replacen(from, to, 1), PAINT);
    let mtl = |from: &str, to: &str| {
        assert!(PAINT.contains(from), "{from}");
        painted(PAINTED, &PAINT.replacen(from, to, 1))
    };
    let cases = [
        (obj("paint.mtl", "absent.mtl"), "a.obj: line 1: "),
        (obj("paint.mtl", "absent.mtl"), "absent.mtl: No such file"),
        (
            obj("mtllib paint.mtl", "mtllib /etc/passwd"),
            "line 1: the file `/etc/passwd` must lie beside the OBJ file",
        ),
        (
            obj("usemtl worn", "usemtl wron"),
            "line 12: the material `wron` is in none of its mtllib files",
        ),
        (
            obj("usemtl red", "usemtl"),
            "line 10: a name must follow `usemtl`",
        ),
        (
            obj("f 1/1 3/2 4/3", "f 1/1 3/2 4"),
            "line 12: the material `worn` has textures, but not all corners",
        ),
        (
            mtl("newmtl red\n", ""),
            "line 1: paint.mtl, line 2: a material must begin with `newmtl`",
        ),
        (
            mtl("Kd 0.5 0.25", "Kd 1.5 0.25"),
            "paint.mtl, line 3: its Kd is [1.5, 0.25, 0.125]: each number must be from 0 to 1",
        ),
        (
            mtl("Ns 30", "Ns shiny"),
            "paint.mtl, line 5: `shiny` is not a number",
        ),
        (
            mtl("Ke 3", "Ke -3"),
            "paint.mtl, line 6: its Ke is [-3, 2, 1]",
        ),
        (
            mtl("\nd 0.5", "\nd"),
            "paint.mtl, line 7: a number must follow `d`",
        ),
        (
            mtl("maps\\wood.png", "maps/oak.png"),
            "paint.mtl, line 11: ",
        ),
        (
            mtl("maps\\wood.png", "maps/oak.png"),
            "oak.png: No such file",
        ),
        (
            mtl("maps\\wood.png", "maps/not.png"),
            "paint.mtl, line 11: maps/not.png: it begins with the bytes",
        ),
        (
            mtl("maps\\wood.png", "../wood.png"),
            "line 11: the file `../wood.png` must lie beside",
        ),
        (
            mtl("-s 1 1 1", "-s 2 2"),
            "line 11: the option `-s 2 2` of a texture is not read",
        ),
        (
            mtl("map_d maps/wood.png", "map_Ke"),
            "line 12: it names no texture",
        ),
    ];
    for (read, sentence) in cases {
        let refusal = read.unwrap_err().to_string();
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
    }
}
