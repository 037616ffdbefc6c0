// CSG boxes in the workgroup's memory, which is nearer than constants when a walk reads one face after the other.

var<workgroup> copied_csg_faces: array<CsgFaceData, CSG_FACE_COUNT>;
var<workgroup> copied_csg_boxes: array<CsgBoxData, CSG_BOX_COUNT>;

fn copy_csg(thread: u32) {
    for (var i = thread; i < CSG_FACE_COUNT; i += BLOCK_PIXELS * WORKGROUP_BLOCKS) {
        copied_csg_faces[i] = scene_storage.csg_faces[i];
    }
    for (var i = thread; i < CSG_BOX_COUNT; i += BLOCK_PIXELS * WORKGROUP_BLOCKS) {
        copied_csg_boxes[i] = scene_storage.csg_boxes[i];
    }
    workgroupBarrier();
}
