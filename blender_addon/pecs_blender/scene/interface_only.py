# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of Blender's RNA on which no render by PECS depends, by the type that declares them: what windows show,
what PECS sets or does not use, what follows from other properties, and what differs from load to load. All others count
for the digest of a scene (content.py). A name alone does not suffice: Object.mode is a window's, RemeshModifier.mode a
shape.

`*` stands for any characters."""

from __future__ import annotations

from .cycles import BOUNCES, SETTINGS

_TABLE = """
Action: pose_markers is_* curve_frame_range frame_range
ActionGroup: select lock show_* use_pin is_* color_set colors
ActionSlot: target_id_type_icon active select show_expanded
AnimData: action_suitable_slots action_tweak_storage
Armature: edit_bones is_editmode display_type show_* axes_position relation_line_position use_mirror_x collections*
Attribute: is_*
BezierSplinePoint: select_* hide
Bone: display_type show_wire hide hide_select select* color collections
BoneColor: *
CacheFile: active_index velocity_unit object_paths
Camera: passepartout_alpha display_size show_* background_images lens_unit stereo
ClothModifier: solver_result hair_grid_*
Collection: all_objects active_exporter_index exporters hide_select hide_viewport color_tag
CollectionChild: *
CollectionObject: *
Constraint: show_expanded active error_* is_*
Curve: is_editmode
CurveMapPoint: select
CurveProfilePoint: select
Curves: points curves position_data normals *attributes curve_offset_data
CyclesObjectSettings: use_deform_motion use_motion_blur motion_steps
CyclesRenderLayerSettings: *
CyclesRenderSettings: device feature_set shading_system samples preview_* *_preview_* use_preview_* *denois* seed
CyclesRenderSettings: use_animated_seed use_light_tree use_adaptive_sampling adaptive_* use_layer_samples
CyclesRenderSettings: sample_offset use_sample_subset sample_subset_length time_limit tile_size debug_* bake_type
CyclesRenderSettings: fast_gi_method
Driver: is_*
DriverTarget: is_*
DriverVariable: show_* is_*
FCurve: select lock hide color* group is_*
FModifier: show_expanded active is_*
FluidDomainSettings: *_grid cell_size domain_resolution start_point has_cache_* is_cache_* cache_frame_pause_*
ID: name_full id_type session_uid is_* original users use_fake_user use_extra_user tag library* asset_data preview
ID: override_library
Image: pixels filepath* packed_file* render_slots bindcode is_* has_data depth size resolution channels frame_duration
Image: display_aspect file_format
ImageUser: frame_current multilayer_*
Key: user
Keyframe: select_* co_ui type
Lattice: is_editmode
LatticePoint: select
LayerCollection: name hide_viewport is_visible
Library: version archive_* parent packed_file
Light: temperature_color
Material: preview_render_type use_preview_world paint_* texture_paint_* is_* line_*
MaterialSlot: name slot_index
Mesh: vertices edges loops polygons vertex_normals polygon_normals corner_normals loop_triangles
Mesh: loop_triangle_polygons vertex_colors color_attributes uv_layer_* remesh_* use_remesh_* use_mirror_* use_paint_*
Mesh: total_* is_* attributes
MeshSkinVertexLayer: data
MeshUVLoopLayer: data uv vertex_selection edge_selection pin active active_clone
MetaBall: is_editmode
MetaElement: select hide
Modifier: show_viewport show_in_editmode show_on_cage show_expanded is_* use_pin_to_last execution_time persistent_uid
MultiresModifier: levels sculpt_levels total_levels
NlaStrip: select active frame_*_ui frame_*_raw
NlaTrack: select lock active is_override_data
Node: location* width height hide label color* parent use_custom_color select show_* bl_* dimensions internal_links
NodeLink: is_hidden
NodeSocket: hide hide_value show_expanded pin_gizmo is_* display_shape description label link_limit select bl_* node
NodeTree: view_center color_tag default_group_node_width description bl_* grease_pencil
NodesModifier: show_group_selector show_manage_panel open_* bake_directory node_warnings panels
NodesModifierBake: directory
Object: mode bound_box dimensions matrix_world matrix_local matrix_basis active_material* active_shape_key*
Object: active_selection_set selection_sets hide_viewport hide_select hide_probe_* display* show_bounds show_name
Object: show_axis show_texture_space show_wire show_all_edges show_transparent show_in_front
Object: show_instancer_for_viewport lock_* show_empty_* empty_display_* use_shape_key_edit_mode use_mesh_mirror_*
Object: motion_path animation_visualization is_instancer is_from_* use_dynamic_topology_sculpting lineart
Object: use_grease_pencil_lights
PackedFile: *
ParticleSettings: show_* display_* active_*
ParticleSystem: particles child_particles active_* is_* dt_frac has_multiple_caches
PointCache: is_* info point_caches name
PointCloud: points *attributes
Pose: use_mirror_* use_auto_ik animation_visualization
PoseBone: matrix matrix_basis matrix_channel head tail length is_* custom_shape* use_custom_shape_* color motion_path
PoseBone: lock_location lock_rotation lock_rotation_w lock_rotations_4d lock_scale select hide
RenderSettings: resolution_* preview_pixel_size pixel_aspect_* ppm_* dither_intensity filter_size use_freestyle
RenderSettings: threads* use_motion_blur motion_blur_* *border* use_crop_to_border use_placeholder use_overwrite
RenderSettings: use_compositing use_sequencer* use_file_extension use_lock_interface filepath *_cache bake* use_bake*
RenderSettings: *stamp* metadata_input sequencer_* use_single_layer use_multiview *views* engine use_persistent_data
RenderSettings: compositor_* line_thickness* image_settings ffmpeg file_extension is_movie_format has_multiple_engines
RenderSettings: use_spherical_stereo simplify_subdivision simplify_child_particles simplify_gpencil*
Scene: frame_current* frame_subframe frame_float frame_end frame_step *preview* lock_frame_selection_to_range show_*
Scene: use_stamp_note sync_mode use_nodes *audio* objects node_tree compositing_node_group sequence_editor
Scene: keying_sets* tool_settings safe_areas timeline_markers transform_orientation_slots cursor *grease_pencil*
Scene: active_clip view_settings display_settings sequencer_colorspace_settings view_layers display eevee hydra
Scene: is_nla_tweakmode time_jump_* annotation
ShapeKey: lock_shape points
Spline: hide
SplinePoint: select hide
SubsurfModifier: levels
Text: current_* select_end* is_* filepath indentation use_*
TextCurve: has_selection is_select_* active_textbox
UDIMTile: size channels is_* label
UnitSettings: system* *_unit use_separate
VertexGroup: lock_weight index
ViewLayer: name samples use_pass_* pass_* active_* aovs lightgroups eevee objects depsgraph freestyle_settings
ViewLayer: use_freestyle use has_export_collections
Volume: grids velocity_*_grid display
World: probe_resolution mist_settings
"""


def _table() -> dict[str, set[str]]:
    table = {"CyclesRenderSettings": {*SETTINGS, *BOUNCES}}  # the latter are in stack.json
    for line in _TABLE.strip().splitlines():
        kind, _, names = line.partition(": ")
        table.setdefault(kind, set()).update(names.split())
    return table


INTERFACE = _table()
