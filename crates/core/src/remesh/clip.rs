//! The surface within a box, with a straight rim.

use std::collections::HashMap;

use glam::{DAffine3, DVec3};

use crate::remesh::joints::blend;
use crate::skin::Sheet;

/// The part of a sheet that lies in a box, given by its lower and its upper corner: triangles are cut along its
/// sides. `pose` takes the sheet to the frame of the box.
///
/// Remeshing needs the surface, its materials and the links that it follows; other columns are not kept. A sheet without triangles, or one
/// that assembly refuses, is returned as it is.
pub fn clip(sheet: &Sheet, pose: DAffine3, [low, high]: [DVec3; 2]) -> Sheet {
    if sheet.triangles.is_empty() || sheet.validate(usize::MAX).is_err() {
        return sheet.clone();
    }
    let mut rest = Sheet {
        name: sheet.name.clone(),
        link: sheet.link,
        positions: sheet.positions.clone(),
        triangles: sheet.triangles.clone(),
        materials: sheet.materials.clone(),
        joints: sheet.joints.clone(),
        binds: sheet.binds.clone(),
        ..Sheet::default()
    };
    for axis in 0..3 {
        cut(&mut rest, |p| pose.transform_point3(p)[axis] - low[axis]);
        cut(&mut rest, |p| high[axis] - pose.transform_point3(p)[axis]);
    }
    rest
}

/// Keeps the side of a plane where the height above it is positive; also what lies in the plane.
fn cut(sheet: &mut Sheet, height: impl Fn(DVec3) -> f64) {
    let heights: Vec<f64> = sheet.positions.iter().map(|&p| height(p)).collect();
    let old = std::mem::take(&mut sheet.positions);
    let mut numbers: HashMap<[u32; 2], u32> = HashMap::new();
    let mut materials = sheet.materials.take().map(|all| (all, Vec::new()));
    let mut joints = sheet.joints.take().map(|all| (all, Vec::new()));
    let mut triangles = Vec::new();
    for (face, corners) in sheet.triangles.iter().enumerate() {
        let mut polygon: Vec<u32> = Vec::with_capacity(4);
        let mut add = |ends: [u32; 2]| {
            let number = *numbers.entry(ends).or_insert_with(|| {
                let number = u32::try_from(sheet.positions.len()).unwrap_or(u32::MAX);
                sheet.positions.push(crossing(ends.map(|v| (old[v as usize], heights[v as usize]))));
                if let Some((all, kept)) = &mut joints {
                    let [a, b] = ends.map(|v| heights[v as usize]);
                    let share = if a == b { 0.0 } else { a / (a - b) };
                    let [from, to] = ends.map(|v| &all[v as usize]);
                    kept.push(if from == to {
                        *from
                    } else {
                        blend([(from, 1.0 - share), (to, share)].into_iter())
                    });
                }
                number
            });
            polygon.push(number);
        };
        for side in 0..3 {
            let (from, to) = (corners[side], corners[(side + 1) % 3]);
            let [here, there] = [from, to].map(|v| heights[v as usize]);
            if here >= 0.0 {
                add([from, from]);
            }
            if here * there < 0.0 {
                add([from.min(to), from.max(to)]);
            }
        }
        for sides in polygon.get(1..).unwrap_or_default().windows(2) {
            triangles.push([polygon[0], sides[0], sides[1]]);
            if let Some((all, kept)) = &mut materials {
                kept.extend(all.get(face));
            }
        }
    }
    sheet.triangles = triangles;
    sheet.materials = materials.map(|(_, kept)| kept);
    sheet.joints = joints.map(|(_, kept)| kept);
}

/// Where an edge meets the plane, from its ends and their heights. The same for both directions of the edge, also
/// where its ends are vertices of their own in the other triangle.
fn crossing(mut ends: [(DVec3, f64); 2]) -> DVec3 {
    let key = |p: DVec3| p.to_array();
    ends.sort_by(|(p, _), (q, _)| key(*p).partial_cmp(&key(*q)).unwrap_or(std::cmp::Ordering::Equal));
    let [(p, above), (q, below)] = ends;
    if p == q { p } else { p + (q - p) * (above / (above - below)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skin::{Joints, LinkId};

    /// New vertices of the rim follow the links of the ends of their edge, as far as they are from them.
    #[test]
    fn what_is_cut_still_follows_its_links() {
        let [arm, hand] = [0, 1].map(LinkId::new);
        let of = |weight: f64| {
            let mut joints = Joints::default();
            (joints[0], joints[1]) = ((arm, 1.0 - weight), (hand, weight));
            joints
        };
        let sheet = Sheet {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            joints: Some([0.0, 1.0, 1.0, 0.0].map(of).to_vec()),
            binds: vec![(arm, DAffine3::IDENTITY), (hand, DAffine3::IDENTITY)],
            ..Sheet::default()
        };
        let part =
            clip(&sheet, DAffine3::IDENTITY, [DVec3::new(0.25, -1.0, -1.0), DVec3::new(0.75, 2.0, 1.0)]);
        assert_eq!(part.binds, sheet.binds);
        let joints = part.joints.unwrap();
        assert_eq!(joints.len(), part.positions.len());
        for (p, joints) in part.positions.iter().zip(&joints) {
            let weight: f64 = joints.iter().filter(|(link, _)| *link == hand).map(|(_, weight)| weight).sum();
            assert!((weight - p.x).abs() < 1e-12, "{p}: {joints:?}");
        }
    }
}
