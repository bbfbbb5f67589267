//! `Skin` and `check`: taxels from files and arrays.

use std::{
    collections::{BTreeMap, HashMap, HashSet},
    path::PathBuf,
    sync::Arc,
};

use dermatome::{
    Skin,
    id::IdVec,
    io::{
        IoError, ReadParts, draft_from_bytes, is_robot, lost_in, read_draft_with, skin_to_bytes, write_skin,
    },
    remesh::{LeftOut, drop_crumbs, keep_outer, remesh_skin},
    skin::{
        AssembleOptions, Draft, Link, LinkId, Oriented, Patch, Presence, Remark, Sheet, TaxelId, assemble,
        check as findings_of, orient,
    },
};
use glam::{DAffine3, DVec3};
use numpy::{PyArray1, PyArray2};
use pyo3::{
    prelude::*,
    types::{PyBytes, PyDict, PyList, PyString, PyTuple},
};

use crate::{
    arguments::{Argument, arg, found, object_or_none},
    arrays::{bytes_of, floats, matrix, one_code_each, one_number_each, points, triangles, vector},
    errors::{bad, error},
    index::pose_of,
    jobs::run,
    options::{direction, fill_holes, positive, unit, weld},
};

/// A skin: taxels on patches, joined by triangles, in the frames of the links of a robot.
///
/// Lengths are in m. Arrays are in the order of the skin: patch after patch, the taxels of each in their order.
/// A skin never changes. It can be pickled; pickled positions are rounded to 32-bit numbers.
///
/// Examples
/// --------
/// >>> import dermatome
/// >>> square = [[0, 0, 0], [0.01, 0, 0], [0.01, 0.01, 0], [0, 0.01, 0]]
/// >>> skin = dermatome.Skin.from_arrays(square, [[0, 1, 2], [0, 2, 3]], patch="palm")
/// >>> skin.patches, skin.n_taxels
/// (('palm',), 4)
#[pyclass(frozen, module = "dermatome", name = "Skin")]
#[derive(Debug)]
pub(crate) struct PySkin {
    pub(crate) skin: Arc<Skin>,
    pub(crate) remarks: Vec<String>,
}

/// How a draft becomes a skin, from arguments.
struct Reading<'a> {
    gap: f64,
    weld: &'a str,
    repair: bool,
    outside: Option<Bound<'a, PyAny>>,
    fill_holes: Option<i64>,
    keep_going: bool,
}

impl Reading<'_> {
    fn options(&self) -> PyResult<AssembleOptions> {
        let outside = self.outside.as_ref().map(|value| direction("outside", value));
        Ok(AssembleOptions {
            gap: self.gap,
            fill_holes: fill_holes(self.fill_holes)?,
            weld: weld(self.weld)?,
            repair: self.repair,
            outside: outside.transpose()?,
            keep_going: self.keep_going,
        })
    }
}

/// The sheets whose name fits one of some patterns of the shell.
fn keep_patches(py: Python<'_>, draft: &mut Draft, patterns: &[String]) -> PyResult<()> {
    let fits = py.import("fnmatch")?.getattr("fnmatchcase")?;
    let mut kept = Vec::new();
    for pattern in patterns {
        let mut found = false;
        for (k, sheet) in draft.sheets.iter().enumerate() {
            if fits.call1((&sheet.name, pattern))?.extract()? {
                kept.push(k);
                found = true;
            }
        }
        if !found {
            let names: Vec<_> = draft.sheets.iter().take(10).map(|sheet| sheet.name.as_str()).collect();
            return Err(bad("patches", format!("{pattern:?}"), format!("one of {names:?}")));
        }
    }
    let mut k = 0..;
    draft.sheets.retain(|_| k.next().is_some_and(|k: usize| kept.contains(&k)));
    Ok(())
}

impl PySkin {
    pub(crate) fn new(skin: Skin, remarks: &[Remark]) -> Self {
        Self { skin: Arc::new(skin), remarks: remarks.iter().map(ToString::to_string).collect() }
    }

    fn assembled(py: Python<'_>, draft: Draft, options: AssembleOptions) -> PyResult<Self> {
        let assembled = run(py, 0, move |_| assemble(&draft, &options))?.map_err(error)?;
        Ok(Self::new(assembled.skin, &assembled.remarks))
    }

    /// The skin without the small pieces of its links.
    fn without_crumbs(self, least_area: f64, spacing: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let spacings = spacing.map(|spacing| spacings(spacing, &self.skin)).transpose()?;
        let (mut skin, mut remarks) = (Arc::unwrap_or_clone(self.skin), self.remarks);
        let dropped = drop_crumbs(&mut skin, least_area, spacings.as_deref());
        remarks.extend(dropped.iter().map(|name| format!("{name}: a small piece of its link, and left out")));
        Ok(Self { skin: Arc::new(skin), remarks })
    }

    /// The skin on which the faces that fill pin-holes are like the others.
    fn without_filled(self) -> Self {
        let mut skin = Arc::unwrap_or_clone(self.skin);
        skin.patches.iter_mut().for_each(|patch| patch.filled = 0);
        Self { skin: Arc::new(skin), ..self }
    }

    /// The same surface, meshed anew with taxels this far apart.
    fn meshed_anew(self, py: Python<'_>, spacing: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (spacings, skin, mut remarks) = (spacings(spacing, &self.skin)?, self.skin, self.remarks);
        let made = run(py, 0, move |stop| remesh_skin(&skin, &spacings, stop.run()))?.map_err(error)?;
        if made.skin.patches.is_empty() {
            return Err(bad(
                "spacing",
                spacing,
                "less: every patch is smaller than the hexagon around one taxel",
            ));
        }
        remarks.extend(
            made.left_out
                .iter()
                .map(|name| format!("{name}: smaller than the hexagon around one taxel, and left out")),
        );
        remarks.extend(made.shrunk.iter().map(|(name, farthest)| {
            format!("{name}: parts thinner than its taxels are apart have none at their ends, up to {:.1} mm of them", 1e3 * farthest)
        }));
        remarks.extend(made.unfilled.iter().map(|(name, count)| {
            format!("{name}: {count} filled holes are open again, with too many taxels around")
        }));
        Ok(Self { skin: Arc::new(made.skin), remarks })
    }
}

/// Whether a file is of CAD, whose triangles need repair more often than not.
fn is_stl(path: &std::path::Path) -> bool {
    path.extension().is_some_and(|kind| {
        ["stl", "dae", "3mf", "urdf", "xml", "mjcf"].iter().any(|cad| kind.eq_ignore_ascii_case(cad))
    })
}

#[pymethods]
impl PySkin {
    /// Read a skin from a file.
    ///
    /// Parameters
    /// ----------
    /// path : str, os.PathLike, or a sequence of them
    ///     .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .3mf, .urdf, .npz, .csv or .txt; several files are one skin.
    /// unit : {"m", "mm", "cm", "dm", "in"} or float
    ///     Unit of the lengths in the file; a number is a length in m.
    /// gap : float
    ///     Longest edge between taxels without triangles over their spacing, a ratio from 1 to 20.
    /// weld : {"auto", "all", "none", "texture"}
    ///     Which vertices at exactly one place become one taxel.
    /// repair : bool, optional
    ///     Whether faulty triangles are repaired; by default those of .stl, .dae, .3mf and .urdf files.
    /// outside : (3,) array_like, optional
    ///     Direction of the outside of taxels without triangles and normals, in the world, of any length, without a unit.
    /// fill_holes : int, optional
    ///     Fill holes of at most this many edges; by default pin-holes.
    /// patches : sequence of str, optional
    ///     Take the patches of these names alone, in which * and ? stand for any characters.
    /// keep_going : bool
    ///     Leave out patches that cannot be repaired.
    /// outer : bool
    ///     Keep what of each link can be touched: the outside of the shells of CAD. Files without links are one body: those
    ///     that lie inside of others are left out, and `remarks` names them.
    /// spacing : float or dict of str to float, optional
    ///     Mesh the surface anew with taxels this far apart, in m: for CAD, whose triangles are no taxels. A dict has a
    ///     spacing for names of links, in which * and ? stand for any characters; the first that fits counts.
    /// least_area : float, optional
    ///     Leave out the smallest pieces of a link, or of CAD without links, that have less than this share of its area
    ///     together, and those with less than twelve taxels of `spacing`; the largest stays, and 0 keeps all. By default
    ///     0.005 of a robot's link.
    ///
    /// Returns
    /// -------
    /// Skin
    ///
    /// Raises
    /// ------
    /// MissingFileError, FileError
    ///     If it does not exist, or cannot be read.
    /// DataError
    ///     If the file is damaged, of an unknown kind, or no skin: the message says which vertex, face or line; or a
    ///     name or number cannot be used.
    #[staticmethod]
    #[pyo3(signature = (path, *, unit=None, gap=2.5, weld="auto", repair=None, outside=None, fill_holes=None,
        patches=None, keep_going=false, outer=false, spacing=None, least_area=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn read(
        py: Python<'_>,
        path: &Bound<'_, PyAny>,
        unit: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] gap: f64,
        #[pyo3(from_py_with = arg)] weld: &str,
        #[pyo3(from_py_with = arg)] repair: Option<bool>,
        outside: Option<Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] fill_holes: Option<i64>,
        #[pyo3(from_py_with = arg)] patches: Option<Vec<String>>,
        #[pyo3(from_py_with = arg)] keep_going: bool,
        #[pyo3(from_py_with = arg)] outer: bool,
        spacing: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] least_area: Option<f64>,
    ) -> PyResult<Self> {
        let paths: Vec<PathBuf> = path
            .extract()
            .map(|path| vec![path])
            .or_else(|_| path.extract())
            .map_err(|_: PyErr| bad("path", found(path), Vec::<PathBuf>::needed()))?;
        let repair = repair.unwrap_or_else(|| paths.iter().any(|path| is_stl(path)));
        let options = Reading { gap, weld, repair, outside, fill_holes, keep_going }.options()?;
        let metres = unit.map_or(Ok(1.0), self::unit)?;
        let parts = ReadParts { texture: weld == "texture", ..ReadParts::default() };
        let is_chosen = patches.is_some();
        let is_robot = matches!(&paths[..], [path] if is_robot(path));
        let outer_of = outer.then_some(options);
        let (mut draft, left_out, oriented) =
            run(py, 0, move |_| read_drafts(&paths, parts, outer_of))?.map_err(error)?;
        // Taxels of sensors are the skin itself.
        let are_taxels = is_robot && draft.sheets.iter().any(|sheet| sheet.triangles.is_empty());
        if outer && draft.sheets.is_empty() {
            return Err(bad("outer", "no face that is outside", "False"));
        }
        if parts.texture && draft.sheets.iter().all(|sheet| sheet.texture.is_none()) {
            return Err(bad(
                "weld",
                "\"texture\"",
                "a file with texture coordinates on all corners of a sheet",
            ));
        }
        patches.map_or(Ok(()), |patterns| keep_patches(py, &mut draft, &patterns))?;
        draft.remarks.append(&mut oriented.remarks(&draft));
        draft.scale(metres);
        let mut skin = Self::assembled(py, draft, options)?;
        skin.remarks.splice(0..0, left_out.notes()).for_each(drop);
        let least_area = least_area.or(is_robot.then_some(0.005)).filter(|_| !is_chosen && !are_taxels);
        if let Some(least_area) = least_area {
            skin = skin.without_crumbs(least_area, spacing)?;
        }
        match spacing {
            Some(spacing) if fill_holes.is_none() => skin.without_filled().meshed_anew(py, spacing),
            Some(spacing) => skin.meshed_anew(py, spacing),
            None => Ok(skin),
        }
    }

    /// Read a skin from the content of a file, which may name no other files.
    ///
    /// Parameters
    /// ----------
    /// data : bytes, bytearray, memoryview
    ///     The content.
    /// kind : str
    ///     The extension of such a file.
    ///
    /// Returns
    /// -------
    /// Skin
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the content is not a whole file of this kind, or no skin.
    #[staticmethod]
    #[pyo3(signature = (data, kind="glb"))]
    fn from_bytes(
        py: Python<'_>,
        data: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = arg)] kind: &str,
    ) -> PyResult<Self> {
        let name = PathBuf::from(format!("skin.{}", kind.trim_start_matches('.')));
        let (repair, data) = (is_stl(&name), bytes_of("data", data)?);
        let draft =
            run(py, 0, move |_| draft_from_bytes(&name, data, ReadParts::default()))?.map_err(error)?;
        Self::assembled(py, draft, AssembleOptions { repair, ..AssembleOptions::default() })
    }

    /// The forearm of the documents: 1000 taxels of one patch, which the package carries.
    ///
    /// Returns
    /// -------
    /// Skin
    ///
    /// Examples
    /// --------
    /// >>> import dermatome
    /// >>> skin = dermatome.Skin.example()
    /// >>> skin.patches, skin.n_taxels
    /// (('forearm',), 1000)
    #[staticmethod]
    fn example(py: Python<'_>) -> PyResult<Self> {
        let folder = py.import("importlib.resources")?.call_method1("files", ("dermatome",))?;
        let data = folder.call_method1("joinpath", ("forearm.glb",))?.call_method0("read_bytes")?;
        Self::from_bytes(py, &data, "glb")
    }

    /// Make a skin from arrays.
    ///
    /// Parameters
    /// ----------
    /// positions : (n, 3) array_like
    ///     Positions of the taxels in the frame of the link, in m.
    /// faces : (m, 3) array_like of int, optional
    ///     Triangles, counter-clockwise from outside; without them the taxels are joined to their neighbours.
    /// normals : (n, 3) array_like, optional
    ///     Outward normals, of any length, without a unit.
    /// ids : (n,) array_like of int, optional
    ///     Ids of the taxels; by default they count from 1.
    /// present : (n,) array_like of int or bool, optional
    ///     1 a working taxel, 0 none, 2 a thermal pad, 3 another sensor.
    /// link, patch : str, or (n,) sequence of str
    ///     Names of the link and of the patch: of all taxels, or of each. Patches are in the order of their first taxels; a
    ///     patch is on one link. Links have no parent; `join` poses them.
    /// gap, weld, repair, outside, fill_holes
    ///     As in `read`.
    ///
    /// Returns
    /// -------
    /// Skin
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If shapes differ, a corner is no position, a number is not finite, or the triangles are no surface.
    #[staticmethod]
    #[pyo3(signature = (positions, faces=None, *, normals=None, ids=None, present=None, link=None, patch=None,
        gap=2.5, weld="auto", repair=false, outside=None, fill_holes=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn from_arrays(
        py: Python<'_>,
        positions: &Bound<'_, PyAny>,
        faces: Option<&Bound<'_, PyAny>>,
        normals: Option<&Bound<'_, PyAny>>,
        ids: Option<&Bound<'_, PyAny>>,
        present: Option<&Bound<'_, PyAny>>,
        link: Option<&Bound<'_, PyAny>>,
        patch: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] gap: f64,
        #[pyo3(from_py_with = arg)] weld: &str,
        #[pyo3(from_py_with = arg)] repair: bool,
        outside: Option<Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] fill_holes: Option<i64>,
    ) -> PyResult<Self> {
        let options = Reading { gap, weld, repair, outside, fill_holes, keep_going: false }.options()?;
        let mut draft = draft_of(positions, faces)?;
        let sheet = &mut draft.sheets[0];
        let count = sheet.positions.len();
        if let Some(value) = normals {
            let normals = points("normals", value)?;
            if normals.len() != count {
                return Err(bad("normals", format!("{} rows", normals.len()), format!("{count} rows")));
            }
            sheet.normals = Some(normals);
        }
        let ids = ids.map(|value| one_number_each("ids", value, count)).transpose()?;
        sheet.ids = ids.map(|ids| ids.into_iter().map(TaxelId).collect());
        sheet.presence = present.map(|value| presence("present", value, count)).transpose()?;
        let patches = names("patch", patch, "skin", count)?;
        split(&mut draft, &patches, &names("link", link, "link", count)?)?;
        Self::assembled(py, draft, options)
    }

    /// Make a skin of a mesh of another package, in m.
    ///
    /// Parameters
    /// ----------
    /// mesh : object
    ///     A mesh of trimesh, open3d, pyvista, meshio or any other with `vertices` and `faces` or `triangles`, or with `points`
    ///     and `faces` or `cells_dict`. Faces of four corners are two triangles; points alone are joined to their neighbours.
    /// normals, ids, present, link, patch, gap, weld, repair, outside, fill_holes
    ///     As in `from_arrays`.
    ///
    /// Returns
    /// -------
    /// Skin
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If it is no mesh, several, or has faces of other corners.
    #[staticmethod]
    #[pyo3(signature = (mesh, *, normals=None, ids=None, present=None, link=None, patch=None,
        gap=2.5, weld="auto", repair=false, outside=None, fill_holes=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn from_mesh<'py>(
        py: Python<'py>,
        mesh: &Bound<'py, PyAny>,
        normals: Option<&Bound<'py, PyAny>>,
        ids: Option<&Bound<'py, PyAny>>,
        present: Option<&Bound<'py, PyAny>>,
        link: Option<&Bound<'py, PyAny>>,
        patch: Option<&Bound<'py, PyAny>>,
        #[pyo3(from_py_with = arg)] gap: f64,
        #[pyo3(from_py_with = arg)] weld: &str,
        #[pyo3(from_py_with = arg)] repair: bool,
        outside: Option<Bound<'py, PyAny>>,
        #[pyo3(from_py_with = arg)] fill_holes: Option<i64>,
    ) -> PyResult<Self> {
        let (positions, faces): (Bound<'_, PyAny>, Option<Bound<'_, PyAny>>) =
            py.import("dermatome._mesh")?.call_method1("arrays_of", (mesh,))?.extract()?;
        let faces = faces.as_ref();
        Self::from_arrays(
            py, &positions, faces, normals, ids, present, link, patch, gap, weld, repair, outside, fill_holes,
        )
    }

    /// Make one skin of several, as the parts of a robot.
    ///
    /// Parameters
    /// ----------
    /// skins : sequence of Skin
    ///     The skins, whose taxels follow each other. A link of one name is one link; a patch whose name is taken gets another
    ///     one, and `remarks` says so.
    /// poses : dict of str to (4, 4) array_like, optional
    ///     Of links by their names, the frame in the world: a rotation and a translation in m, as `Index.posed` and
    ///     `Robot.poses` have it. Others keep the pose relative to their parent.
    ///
    /// Returns
    /// -------
    /// Skin
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If links of one name differ in parent or pose, or a pose is not rigid or of no link.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome, numpy as np
    /// >>> grid = np.array([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)])
    /// >>> palm, thumb = (dermatome.Skin.from_arrays(grid, patch=name, link=name) for name in ("palm", "thumb"))
    /// >>> pose = np.eye(4)
    /// >>> pose[0, 3] = 0.1
    /// >>> hand = dermatome.Skin.join([palm, thumb], poses={"thumb": pose})
    /// >>> hand.patches, hand.links, hand.n_taxels
    /// (('palm', 'thumb'), ('palm', 'thumb'), 162)
    #[staticmethod]
    #[pyo3(signature = (skins, *, poses=None))]
    fn join(
        #[pyo3(from_py_with = arg)] skins: Vec<Bound<'_, Self>>,
        #[pyo3(from_py_with = object_or_none)] poses: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let mut given = Vec::new();
        for (name, value) in poses.into_iter().flatten() {
            let name: String =
                name.extract().map_err(|_| bad("poses", "a key that is no str", "the name of a link"))?;
            given.push((pose_of(&format!("poses[{name:?}]"), &value)?, name));
        }
        let (mut joined, mut remarks) = (Skin::default(), Vec::new());
        for (number, skin) in skins.iter().enumerate() {
            let mut skin = Skin::clone(&skin.get().skin);
            for (_, name) in &given {
                let links = skin.links.iter().filter(|link| link.name == *name).count();
                if links > 1 {
                    let found = format!("{name:?}, the name of {links} links of skins[{number}]");
                    return Err(bad("poses", found, "the name of one link of a skin alone"));
                }
            }
            set_poses(&mut skin, &given);
            let renamed = joined.append(&skin);
            remarks.extend(renamed.iter().map(ToString::to_string));
        }
        remarks.splice(0..0, skins.iter().flat_map(|skin| skin.get().remarks.iter().cloned()));
        let mut names = HashSet::new();
        if let Some(link) = joined.links.iter().find(|link| !names.insert(link.name.as_str())) {
            let found = format!("two links {:?} with another parent or pose", link.name);
            return Err(bad("skins", found, "other names, or poses of this link"));
        }
        if let Some((_, name)) = given.iter().find(|(_, name)| !names.contains(name.as_str())) {
            return Err(bad("poses", format!("{name:?}"), "the names of links of the skins"));
        }
        joined.validate().map_err(error)?;
        let ids = joined.patches.iter().flat_map(|patch| patch.taxels.ids.iter());
        let mut counts = BTreeMap::new();
        ids.for_each(|id| *counts.entry(id.0).or_insert(0_usize) += 1);
        let shared = counts.values().filter(|count| **count > 1).count();
        if shared > 0 {
            remarks.push(format!("{shared} ids belong to several taxels, which share their readings"));
        }
        Ok(Self { skin: Arc::new(joined), remarks })
    }

    /// Write the skin to a file; its kind follows from its extension.
    ///
    /// Returns
    /// -------
    /// tuple of str
    ///     What a file of this kind does not keep, a sentence each; .glb keeps everything.
    ///
    /// Raises
    /// ------
    /// FileError
    ///     If it cannot be written.
    /// DataError
    ///     If the kind is unknown or cannot hold the skin.
    fn write<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = arg)] path: PathBuf,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let (skin, to) = (Arc::clone(&self.skin), path.clone());
        run(py, 0, move |_| write_skin(&to, &skin))?.map_err(error)?;
        PyTuple::new(py, lost_in(&path, &self.skin))
    }

    /// The content of a file of this skin, of a kind that is one file.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the kind is unknown, is several files, or cannot hold the skin.
    #[pyo3(signature = (kind="glb"))]
    fn to_bytes<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = arg)] kind: &str,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let name = PathBuf::from(format!("skin.{}", kind.trim_start_matches('.')));
        let skin = Arc::clone(&self.skin);
        Ok(PyBytes::new(py, &run(py, 0, move |_| skin_to_bytes(&name, &skin))?.map_err(error)?))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let py = slf.py();
        Ok((py.get_type::<Self>().getattr("from_bytes")?, (slf.get().to_bytes(py, "glb")?,)))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __repr__(&self) -> String {
        format!("<dermatome.Skin: {} taxels, {} patches>", self.n_taxels(), self.skin.patches.len())
    }

    /// tuple of str: What was changed or left out when the skin was read.
    #[getter]
    fn remarks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.remarks)
    }

    /// tuple of str: Names of the patches, in the order of the skin.
    #[getter]
    fn patches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.skin.patches.iter().map(|patch| &patch.name))
    }

    /// tuple of str: Names of the links; a parent comes before its children.
    #[getter]
    fn links<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.skin.links.iter().map(|link| &link.name))
    }

    /// int: Number of taxels, N.
    #[getter]
    fn n_taxels(&self) -> usize {
        self.skin.patches.iter().map(|patch| patch.mesh.positions.len()).sum()
    }

    /// (N, 3) float64 array: Positions of the taxels in the frames of their links, in m.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let patches = self.skin.patches.iter();
        matrix(py, patches.flat_map(|patch| patch.mesh.positions.iter().map(DVec3::to_array)))
    }

    /// (N, 3) float64 array: Outward unit normals.
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let patches = self.skin.patches.iter();
        matrix(py, patches.flat_map(|patch| patch.taxels.normals.iter().map(DVec3::to_array)))
    }

    /// (m, 3) uint32 array: Triangles of all patches, which count taxels of the whole skin.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let mut first = 0;
        let mut faces = Vec::new();
        for patch in &self.skin.patches {
            faces.extend(patch.mesh.triangles.iter().map(|corners| corners.map(|v| first + v.raw())));
            first += u32::try_from(patch.mesh.positions.len()).unwrap_or(u32::MAX);
        }
        matrix(py, faces)
    }

    /// (N,) uint32 array: Ids of the taxels.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.skin.patches.iter().flat_map(|patch| patch.taxels.ids.iter().map(|id| id.0)))
    }

    /// (N,) float64 array: Receptive areas, in m^2.
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.skin.patches.iter().flat_map(|patch| patch.taxels.areas.iter().copied()))
    }
}

/// What some files hold, as one draft; with options for the outside alone what was left out since it is not seen, and
/// what was turned over before.
fn read_drafts(
    paths: &[PathBuf],
    parts: ReadParts,
    outer: Option<AssembleOptions>,
) -> Result<(Draft, LeftOut, Oriented), IoError> {
    let mut drafts = paths.iter().map(|path| read_draft_with(path, parts));
    let mut draft = drafts.next().transpose()?.unwrap_or_default();
    drafts.try_for_each(|other| other.map(|other| draft.append(other)))?;
    let Some(options) = outer else { return Ok((draft, LeftOut::default(), Oriented::default())) };
    let oriented = orient(&mut draft, &options);
    let left_out = keep_outer(&mut draft);
    Ok((draft, left_out, oriented))
}

/// The wanted spacing of the taxels of each patch, in m: a number, or one for names of links.
fn spacings(value: &Bound<'_, PyAny>, skin: &Skin) -> PyResult<Vec<f64>> {
    let length = |value: &Bound<'_, PyAny>| {
        let metres = value.extract().map_err(|_| bad("spacing", found(value), "a length in m"));
        positive("spacing", metres?)
    };
    let Ok(of_links) = value.cast::<PyDict>() else {
        return Ok(vec![length(value)?; skin.patches.len()]);
    };
    let fits = value.py().import("fnmatch")?.getattr("fnmatchcase")?;
    for pattern in of_links.keys() {
        pattern.cast::<PyString>().map_err(|_| bad("spacing", found(&pattern), "names of links"))?;
    }
    let of_patch = |patch: &Patch| {
        let name = &skin.links[patch.link].name;
        for (pattern, spacing) in of_links {
            if fits.call1((name, &pattern))?.extract()? {
                return length(&spacing);
            }
        }
        Err(bad("spacing", format!("no name of the link {name:?}"), "one, or \"*\" for all others"))
    };
    skin.patches.iter().map(of_patch).collect()
}

/// Gives links their frames in the world; others keep their pose relative to their parent.
fn set_poses(skin: &mut Skin, poses: &[(DAffine3, String)]) {
    let mut world: IdVec<LinkId, DAffine3> = IdVec::default();
    for link in skin.links.iter_mut() {
        let parent = link.parent.map_or(DAffine3::IDENTITY, |parent| world[parent]);
        if let Some((pose, _)) = poses.iter().find(|(_, name)| *name == link.name) {
            link.pose = if link.parent.is_some() { parent.inverse() * *pose } else { *pose };
        }
        world.push(parent * link.pose);
    }
}

/// Names of `count` taxels: one for all, or one for each.
fn names(
    argument: &str,
    value: Option<&Bound<'_, PyAny>>,
    default: &str,
    count: usize,
) -> PyResult<Vec<String>> {
    let Some(value) = value else { return Ok(vec![default.to_owned(); count]) };
    if let Ok(name) = value.extract::<String>() {
        return Ok(vec![name; count]);
    }
    let names: Vec<String> = value.extract().map_err(|_| {
        bad(argument, value.get_type().name().map_or_else(|_| String::new(), |n| n.to_string()), "words")
    })?;
    if names.len() == count {
        Ok(names)
    } else {
        Err(bad(argument, names.len(), format!("a word, or {count}")))
    }
}

/// Splits the one sheet of a draft by the patches of its taxels, and gives each its link.
fn split(draft: &mut Draft, patches: &[String], links: &[String]) -> PyResult<()> {
    let link = |name: &String| Link { name: name.clone(), parent: None, pose: DAffine3::IDENTITY };
    if patches.iter().zip(links).all(|(patch, link)| (patch, link) == (&patches[0], &links[0])) {
        draft.sheets[0].name = patches.first().cloned().unwrap_or_default();
        draft.sheets[0].link = links.first().map(|name| draft.links.push(link(name)));
        return Ok(());
    }
    let whole = std::mem::take(&mut draft.sheets[0]);
    let mut places: HashMap<&str, usize> = HashMap::new();
    let (mut taxels, mut number): (Vec<Vec<usize>>, _) = (Vec::new(), Vec::new());
    for (k, patch) in patches.iter().enumerate() {
        let place = *places.entry(patch).or_insert(taxels.len());
        if place == taxels.len() {
            taxels.push(Vec::new());
        }
        number.push(u32::try_from(taxels[place].len()).unwrap_or(u32::MAX));
        taxels[place].push(k);
    }
    let mut faces = vec![Vec::new(); taxels.len()];
    for (k, corners) in whole.triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|v| &*patches[v as usize]);
        if a != b || a != c {
            return Err(bad(
                &format!("faces[{k}]"),
                format!("taxels of the patches {a:?}, {b:?} and {c:?}"),
                "of one",
            ));
        }
        faces[places[a]].push(corners.map(|v| number[v as usize]));
    }
    fn some<T: Clone>(all: Option<&Vec<T>>, taxels: &[usize]) -> Option<Vec<T>> {
        all.map(|all| taxels.iter().map(|&k| all[k].clone()).collect())
    }
    // Ids count all taxels as they were given.
    let ids = whole.ids.unwrap_or_else(|| (1..).take(patches.len()).map(TaxelId).collect());
    draft.sheets = Vec::new();
    for (taxels, triangles) in taxels.iter().zip(faces) {
        let (name, of_first) = (&patches[taxels[0]], &links[taxels[0]]);
        if let Some(&k) = taxels.iter().find(|&&k| links[k] != *of_first) {
            let needed = format!("{of_first:?}, that of the other taxels of the patch {name:?}");
            return Err(bad(&format!("link[{k}]"), format!("{:?}", links[k]), needed));
        }
        let known = draft.links.enumerate().find(|(_, known)| known.name == *of_first).map(|(id, _)| id);
        let link = known.unwrap_or_else(|| draft.links.push(link(of_first)));
        draft.sheets.push(Sheet {
            name: name.clone(),
            link: Some(link),
            triangles,
            positions: some(Some(&whole.positions), taxels).unwrap_or_default(),
            ids: some(Some(&ids), taxels),
            normals: some(whole.normals.as_ref(), taxels),
            presence: some(whole.presence.as_ref(), taxels),
            ..Sheet::default()
        });
    }
    Ok(())
}

/// A draft of one sheet.
fn draft_of(positions: &Bound<'_, PyAny>, faces: Option<&Bound<'_, PyAny>>) -> PyResult<Draft> {
    let positions = points("positions", positions)?;
    let faces = faces.map(|faces| triangles("faces", faces, positions.len())).transpose()?;
    let sheet = Sheet { positions, triangles: faces.unwrap_or_default(), ..Sheet::default() };
    Ok(Draft { sheets: vec![sheet], ..Draft::default() })
}

fn presence(name: &str, value: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<Presence>> {
    let known = [Presence::Absent, Presence::Present, Presence::ThermalPad, Presence::Other];
    let numbers = one_code_each(name, value, count)?.into_iter().enumerate();
    let of = |(k, found): (usize, u32)| {
        known.get(found as usize).copied().ok_or_else(|| bad(&format!("{name}[{k}]"), found, "0, 1, 2 or 3"))
    };
    numbers.map(of).collect()
}

/// List everything that is wrong with a skin; empty for a healthy one.
///
/// Parameters
/// ----------
/// source : str, os.PathLike or (n, 3) array_like
///     A file, or positions of taxels in m.
/// faces : (m, 3) array_like of int, optional
///     The triangles of these taxels.
/// unit, gap, weld, repair
///     As in `Skin.read`.
///
/// Returns
/// -------
/// list of dict
///     For each finding its `kind`, `severity` ("error": `build` refuses it), `patch`, `elements` (numbers of
///     vertices or faces) and `message`.
///
/// Raises
/// ------
/// MissingFileError, FileError
///     If it does not exist, or cannot be read.
/// DataError
///     If it cannot be read at all; what is wrong with a skin is a finding.
///
/// Examples
/// --------
/// >>> import dermatome
/// >>> twisted = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
/// >>> [f["kind"] for f in dermatome.check(twisted, [[0, 1, 2], [1, 2, 3]])]
/// ['inconsistent-winding']
#[pyfunction]
#[pyo3(signature = (source, faces=None, *, unit=None, gap=2.5, weld="auto", repair=None))]
pub(crate) fn check<'py>(
    py: Python<'py>,
    source: &Bound<'py, PyAny>,
    faces: Option<&Bound<'py, PyAny>>,
    unit: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = arg)] gap: f64,
    #[pyo3(from_py_with = arg)] weld: &str,
    #[pyo3(from_py_with = arg)] repair: Option<bool>,
) -> PyResult<Bound<'py, PyList>> {
    let (mut draft, stl) = match (source.extract::<PathBuf>(), faces) {
        (Ok(path), None) => {
            let stl = is_stl(&path);
            (run(py, 0, move |_| read_draft_with(&path, ReadParts::default()))?.map_err(error)?, stl)
        }
        (Ok(_), Some(_)) => return Err(bad("faces", "triangles of a file", "None")),
        (Err(_), faces) => {
            floats("source", source)?;
            (draft_of(source, faces)?, false)
        }
    };
    let repair = repair.unwrap_or(stl);
    let options =
        Reading { gap, weld, repair, outside: None, fill_holes: None, keep_going: false }.options()?;
    draft.scale(unit.map_or(Ok(1.0), self::unit)?);
    let findings = run(py, 0, move |_| findings_of(&draft, &options))?;
    let all = PyList::empty(py);
    for found in findings {
        let object = PyDict::new(py);
        object.set_item("kind", found.kind.to_string())?;
        object.set_item("severity", found.severity().to_string())?;
        object.set_item("patch", &found.patch)?;
        object.set_item("elements", found.elements.numbers())?;
        object.set_item("message", found.message())?;
        all.append(object)?;
    }
    Ok(all)
}
