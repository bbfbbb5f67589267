//! Each engine on the same contacts: `single path batch build`, and the eight nearest vertices.

use std::{
    num::NonZero,
    time::{Duration, Instant},
};

use dermatome::{
    contact::{IndexOptions, Query},
    pyramid::LevelId,
    run::Run,
};
use glam::{DVec3, Vec3, Vec3A};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use obvhs::{
    BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, builder::build_bvh2},
    triangle::Triangle,
};
use parry3d::{query::PointQuery, shape::TriMesh};

use crate::{Error, mesh::Mesh, nanoseconds};

type Times = [Option<f64>; 4];

/// How many vertices are looked for.
const NEAREST: usize = 8;

fn wide(p: &[f32; 3]) -> DVec3 {
    Vec3::from(*p).as_dvec3()
}

pub fn dermatome(mesh: &Mesh, scattered: &[[f32; 3]], path: &[[f32; 3]]) -> Result<Times, Error> {
    let start = Instant::now();
    let index = mesh.index(&IndexOptions::default())?;
    let build = start.elapsed().as_secs_f64() * 1e3;
    let distance = |p: &[f32; 3]| index.locate(wide(p)).map_or(f64::NAN, |hit| hit.distance);
    let single = nanoseconds(scattered, |contacts| contacts.iter().map(distance).sum());
    let along = nanoseconds(path, |contacts| contacts.iter().map(distance).sum());
    let mut many: Vec<[f32; 3]> = Vec::with_capacity(1 << 20);
    while many.len() < 1 << 20 {
        // The same places, not the same points.
        let shift = 1e-5 * (many.len() >> 15) as f32;
        many.extend(scattered.iter().map(|p| p.map(|x| x + shift)));
    }
    let queries: Vec<Query> = many.iter().map(|p| Query::from(wide(p))).collect();
    let mut batch = f64::INFINITY;
    for _ in 0..9 {
        let start = Instant::now();
        std::hint::black_box(index.locate_all(&queries, Run::default())?);
        batch = batch.min(start.elapsed().as_secs_f64() * 1e9 / queries.len() as f64);
    }
    Ok([Some(single), Some(along), Some(batch), Some(build)])
}

/// The eight vertices nearest to each contact, in nanoseconds, and a checksum of their distances.
pub fn dermatome_nearest(mesh: &Mesh, scattered: &[[f32; 3]]) -> Result<[f64; 2], Error> {
    let index = mesh.index(&IndexOptions { fields: true, ..IndexOptions::default() })?;
    let level = LevelId::new(0);
    let sum = |p: &[f32; 3]| match index.nearest_fields(wide(p), NEAREST, level) {
        Ok(found) => found.iter().map(|field| field.distance).sum(),
        Err(_) => f64::NAN,
    };
    Ok([nanoseconds(scattered, |c| c.iter().map(sum).sum()), scattered.iter().map(sum).sum()])
}

pub fn kiddo(mesh: &Mesh, scattered: &[[f32; 3]]) -> Result<[f64; 2], Error> {
    let points: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
    let tree = ImmutableKdTree::new_from_slice(&points)?;
    let count = NonZero::new(NEAREST).ok_or("none are asked for")?;
    let sum = |p: &[f32; 3]| {
        let found = tree.query(&p.map(f64::from)).nearest_n::<SquaredEuclidean<f64>>(count).execute();
        found.iter().map(|item| item.distance.sqrt()).sum::<f64>()
    };
    Ok([nanoseconds(scattered, |c| c.iter().map(sum).sum()), scattered.iter().map(sum).sum()])
}

pub fn parry(mesh: &Mesh, scattered: &[[f32; 3]], path: &[[f32; 3]]) -> Result<Times, Error> {
    let start = Instant::now();
    let vertices = mesh.positions.iter().map(|p| parry3d::math::Vector::new(p.x as f32, p.y as f32, p.z as f32));
    let tree = TriMesh::new(vertices.collect(), mesh.triangles.clone())?;
    let build = start.elapsed().as_secs_f64() * 1e3;
    let distance = |p: &[f32; 3]| {
        f64::from(tree.project_local_point(parry3d::math::Vector::new(p[0], p[1], p[2]), false).point.x)
    };
    let [single, along] = [scattered, path].map(|contacts| nanoseconds(contacts, |c| c.iter().map(distance).sum()));
    Ok([Some(single), Some(along), None, Some(build)])
}

pub fn obvhs(mesh: &Mesh, scattered: &[[f32; 3]], path: &[[f32; 3]]) -> Times {
    let start = Instant::now();
    let triangles: Vec<Triangle> = mesh
        .triangles
        .iter()
        .map(|t| {
            let [v0, v1, v2] = t.map(|v| mesh.positions[v as usize].as_vec3a());
            Triangle { v0, v1, v2 }
        })
        .collect();
    let tree = build_bvh2(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
    let build = start.elapsed().as_secs_f64() * 1e3;
    let mut stack = Vec::new();
    let mut distance = |p: &[f32; 3]| f64::from(nearest(&tree, &triangles, Vec3A::from(*p), &mut stack));
    let single = nanoseconds(scattered, |c| c.iter().map(&mut distance).sum());
    let along = nanoseconds(path, |c| c.iter().map(&mut distance).sum());
    [Some(single), Some(along), None, Some(build)]
}

fn to_box(b: &Aabb, q: Vec3A) -> f32 {
    q.distance_squared(q.clamp(b.min, b.max))
}

/// Squared distance of the nearest triangle: depth first, the nearer child first.
fn nearest(tree: &Bvh2, triangles: &[Triangle], q: Vec3A, stack: &mut Vec<(f32, u32)>) -> f32 {
    let mut best = f32::INFINITY;
    stack.clear();
    stack.push((0.0, 0));
    while let Some((squared, at)) = stack.pop() {
        if squared >= best {
            continue;
        }
        let node = &tree.nodes[at as usize];
        if node.is_leaf() {
            for k in node.first_index..node.first_index + node.prim_count {
                let triangle = &triangles[tree.primitive_indices[k as usize] as usize];
                best = best.min(to_triangle(q, triangle));
            }
            continue;
        }
        let children = [node.first_index, node.first_index + 1];
        let [a, b] = children.map(|c| (to_box(tree.nodes[c as usize].aabb(), q), c));
        let (near, far) = if a.0 <= b.0 { (a, b) } else { (b, a) };
        for entry in [far, near] {
            if entry.0 < best {
                stack.push(entry);
            }
        }
    }
    best
}

/// Ericson, Real-Time Collision Detection, 5.1.5.
fn to_triangle(p: Vec3A, t: &Triangle) -> f32 {
    let (a, b, c) = (t.v0, t.v1, t.v2);
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    let nearest = 'found: {
        if d1 <= 0.0 && d2 <= 0.0 {
            break 'found a;
        }
        let bp = p - b;
        let (d3, d4) = (ab.dot(bp), ac.dot(bp));
        if d3 >= 0.0 && d4 <= d3 {
            break 'found b;
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            break 'found a + ab * (d1 / (d1 - d3));
        }
        let cp = p - c;
        let (d5, d6) = (ab.dot(cp), ac.dot(cp));
        if d6 >= 0.0 && d5 <= d6 {
            break 'found c;
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            break 'found a + ac * (d2 / (d2 - d6));
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            break 'found b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
        }
        let scale = 1.0 / (va + vb + vc);
        a + ab * (vb * scale) + ac * (vc * scale)
    };
    p.distance_squared(nearest)
}
