//! Tests of materials of OBJ files.

use glam::Vec3;

use super::*;
use crate::scene::{ColorSpace, Layers, Opacity, Scene, Wrap};
use crate::texture_file::{Texels, encode_png};

const PAINT: &str = "# two\nnewmtl red\nKd 0.5 0.25 0.125\nKs 0.5 0.5 0.5\nNs 30\nKe 3 2 1\nd 0.5\nillum 2\n\n\
    newmtl worn\nmap_Kd -clamp on -s 1 1 1 maps\\wood.png\nmap_d maps/wood.png\nnorm -bm 0.5 maps/wood.png\n\
    Pr 0.25\nPm 1\nPc 0.5\nPcr 0.125\n";
const PAINTED: &str = "mtllib paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n\
    f 1 2 3\nusemtl red\nf 1 2 4\nusemtl worn\nf 1/1 3/2 4/3\nusemtl red\nf 2 3 4\n";

/// An OBJ file with its materials and a texture, in a folder of its own.
fn painted(obj: &str, mtl: &str) -> Result<ObjScene, Error> {
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
    // Read as one mesh, it has all faces and no materials.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.obj");
    std::fs::write(&path, PAINTED).unwrap();
    assert_eq!(Mesh::load(&path).unwrap().triangles.len(), 4);
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
