#pragma once

// Pieces of a furnished room. Each stands at a frame whose origin is on the floor under its middle, z up.

#include "simulate/counter_rng.h"
#include "simulate/mesh_builder.h"

namespace lapseam::simulation {

Material make_material(Pattern pattern, std::uint32_t srgb_a, std::uint32_t srgb_b, double scale_m, Dice& dice);
/// On the floor (or at height z), turned about the vertical.
Eigen::Isometry3d standing_at(double x, double y, double yaw_rad = 0, double z = 0);

using Frame = Eigen::Isometry3d;

void add_table_group(MeshBuilder& builder, const Frame& frame, Dice& dice);  ///< table, four chairs, things on it
void add_chair(MeshBuilder& builder, const Frame& frame, Dice& dice);        ///< 24 mm legs, 12 mm spindles
void add_bookshelf(MeshBuilder& builder, const Frame& frame, double width_m, double height_m,
                   Dice& dice);                                            ///< opens to +y
void add_sofa(MeshBuilder& builder, const Frame& frame, Dice& dice);       ///< faces +y
void add_sideboard(MeshBuilder& builder, const Frame& frame, Dice& dice);  ///< faces +y; globe, ring, vase on it
void add_partition(MeshBuilder& builder, const Frame& frame, double length_m, double height_m, double thickness_m,
                   Dice& dice);                                              ///< along x, a different side each
void add_drying_rack(MeshBuilder& builder, const Frame& frame, Dice& dice);  ///< rods of 5 and 10 mm
void add_floor_lamp(MeshBuilder& builder, const Frame& frame, Dice& dice);   ///< 10 mm pole, 5 mm cable
void add_plant(MeshBuilder& builder, const Frame& frame, Dice& dice);
void add_pouf(MeshBuilder& builder, const Frame& frame, Dice& dice);
void add_basket(MeshBuilder& builder, const Frame& frame, Dice& dice);  ///< open, 4 mm wall
void add_rug(MeshBuilder& builder, const Frame& frame, double length_m, double width_m, Dice& dice);
void add_picture(MeshBuilder& builder, const Frame& frame, double width_m, double height_m, Pattern pattern,
                 Dice& dice);  ///< hangs in the plane y = 0, faces +y
void add_pendant_lamp(MeshBuilder& builder, const Frame& frame, double ceiling_m, Dice& dice);  ///< on a 5 mm cable
void add_vase(MeshBuilder& builder, const Frame& frame, double height_m, Dice& dice);
void add_radiator(MeshBuilder& builder, const Frame& frame, double width_m, Dice& dice);  ///< 0 ≤ y, on a wall
/// A wavy cloth and half a 10 mm rod above it, along x.
void add_curtain_rail(MeshBuilder& builder, const Frame& frame, double opening_m, double height_m, Dice& dice);

}  // namespace lapseam::simulation
