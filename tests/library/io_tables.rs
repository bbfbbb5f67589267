//! Tables of contacts, lookups and poses: what is read, what is written, what is refused and how it
//! is named.

use std::{fs, io::Read, path::Path};

use dermatome::{
    contact::{Cell, ContactIndex},
    id::{FaceId, VertexId},
    io::{
        ContactRow, IoError, LookupPlace, LookupRow, LookupWriter, read_contacts, read_draft, read_motion,
        read_response, write_response,
    },
    map::SkinMap,
    mesh::{SurfacePoint, shapes},
    pyramid::LevelId,
    signal::{Response, Scale, TaxelResponse, TaxelState},
    skin::{Link, LinkId, Motion, PatchId, Presence, TaxelId},
};
use glam::{DAffine3, DVec2, DVec3};

fn read(text: &str) -> Vec<Result<ContactRow, IoError>> {
    read_contacts(Path::new("-"), text.as_bytes()).unwrap().1.collect()
}

fn message<T>(result: Result<T, IoError>) -> String {
    result.err().unwrap().to_string()
}

#[test]
fn columns_come_in_any_order_and_cells_may_be_empty() {
    let text = "\u{feff}time, z ,link,y,x,radius,force,only_link,nz,ny,nx\r\n0.5,3,\"left, arm\",2,1e0,,-2,hand,1,0,0\r\n,0,,0,0,,,,,,\r\n";
    let rows: Vec<ContactRow> = read(text).into_iter().map(Result::unwrap).collect();
    let full = ContactRow {
        position: Some(DVec3::new(1.0, 2.0, 3.0)),
        normal: Some(DVec3::Z),
        force: Some(-2.0),
        radius: None,
        frame: None,
        link: Some("left, arm".into()),
        only_link: Some("hand".into()),
        time: Some(0.5),
        line: 2,
    };
    let bare = ContactRow {
        position: Some(DVec3::ZERO),
        normal: None,
        force: None,
        radius: None,
        frame: None,
        link: None,
        only_link: None,
        time: None,
        line: 3,
    };
    assert_eq!(rows, [full, bare]);
}

#[test]
fn unknown_columns_are_listed() {
    let (unknown, _) = read_contacts(Path::new("-"), &b"x,y,z,colour\n"[..]).unwrap();
    assert_eq!(unknown, ["colour"]);
    let (unknown, rows) = read_contacts(Path::new("-"), &b"x,y,z,,\n1,2,3,,\n"[..]).unwrap();
    assert_eq!((unknown, rows.flatten().count()), (vec![String::new(); 2], 1), "as spreadsheets write them");
}

/// The frame of an answer is that of its point; elsewhere a frame is the number of an image.
#[test]
fn answers_name_the_frame_of_their_points() {
    let header = "contact,patch,link,frame,x,y,z\n";
    let rows = read(&format!("{header}0,cap,arm,world,1,2,3\n1,cap,arm,hand,1,2,3\n2,off skin,,world,,,\n"));
    let rows: Vec<ContactRow> = rows.into_iter().map(Result::unwrap).collect();
    assert!(rows.iter().all(|row| row.link.is_none()));
    let frames: Vec<_> = rows.iter().map(|row| row.frame.as_deref()).collect();
    assert_eq!(frames, [Some("world"), Some("hand"), Some("world")]);
    let point = Some(DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(rows.iter().map(|row| row.position).collect::<Vec<_>>(), [point, point, None]);
    let numbered = read("frame,link,x,y,z\n25,arm,1,2,3\n").remove(0).unwrap();
    assert_eq!((numbered.frame, numbered.link.as_deref()), (None, Some("arm")));
    assert!(read("frame,patch,x,y,z\n25,off skin,,,\n")[0].is_err(), "not a table of answers");
}

#[test]
fn a_broken_line_is_named_and_the_next_one_read() {
    let rows = read("x,y,z,nx,ny,nz,radius\n0,0,NaN,,,,\n0,0,0,1,,0,\n0,0,0,,,,-1\n0,0\n1,2,3,,,,\n");
    let places = [
        "line 2, column `z`: found \"NaN\"",
        "line 3, column `ny`",
        "line 4, column `radius`",
        "line 5: found 2 cells",
    ];
    let mut rows = rows.into_iter();
    for place in places {
        let found = message(rows.next().unwrap());
        assert!(found.contains(place), "{place:?} is named in {found:?}");
    }
    let last = rows.next().unwrap().unwrap();
    assert_eq!((last.position, last.line), (Some(DVec3::new(1.0, 2.0, 3.0)), 6));
    assert!(rows.next().is_none());
}

#[test]
fn headers_without_a_position_or_with_a_name_twice_are_refused() {
    for (header, place) in
        [("", "the names of the columns"), ("x,y\n", "a column `z`"), ("x,y,z,x\n", "line 1, column 4")]
    {
        let found = message(read_contacts(Path::new("-"), header.as_bytes()));
        assert!(found.contains(place), "{place:?} is named in {found:?}");
    }
    let latin = message(read_contacts(Path::new("-"), &b"x,y,z,\xfc\n"[..]));
    assert!(latin.contains("UTF-8"), "{latin}");
}

/// A line without end, and a quote that is never closed, end the table instead of filling the
/// memory.
#[test]
fn an_endless_line_is_refused() {
    for start in ["", "\""] {
        let endless = format!("x,y,z\n{start}").into_bytes();
        let input = endless.as_slice().chain(std::io::repeat(b'1'));
        let (_, mut rows) = read_contacts(Path::new("-"), input).unwrap();
        let found = message(rows.next().unwrap());
        assert!(found.contains("more than 1048576 bytes"), "{found}");
        assert!(rows.next().is_none(), "the stream is given up");
    }
}

#[test]
fn a_long_table_passes_though_its_lines_together_are_long() {
    let line = format!("0,0,0,{}\n", "l".repeat(1000));
    let text = "x,y,z,link\n".to_owned() + &line.repeat(3000);
    assert_eq!(read(&text).into_iter().filter(Result::is_ok).count(), 3000);
}

/// However lines end, and whatever stands between them, an error names the line that an editor
/// shows.
#[test]
fn lines_are_counted_as_an_editor_counts_them() {
    let text = "x,y,z,link\n\n0,0,0,\n\n\n0,0,oops,\n0,0,0,\"two\nlines\"\n0,oops,0,\n";
    let folder = tempfile::tempdir().unwrap();
    for text in [text.to_owned(), text.replace('\n', "\r\n")] {
        let rows = read(&text);
        let lines: Vec<_> = rows.iter().flatten().map(|row| row.line).collect();
        assert_eq!(lines, [3, 7], "a contact is one line, whatever its quotes: {text:?}");
        let errors: Vec<_> = rows.into_iter().filter_map(Result::err).map(|e| e.to_string()).collect();
        assert!(errors[0].contains("line 6, column `z`"), "{text:?}: {}", errors[0]);
        assert!(errors[1].contains("line 8: found 1 cells"), "{text:?}: {}", errors[1]);
        assert!(errors[2].contains("line 9, column `y`"), "{text:?}: {}", errors[2]);
        let path = folder.path().join("skin.csv");
        fs::write(&path, text.replace("link", "patch")).unwrap();
        let found = message(read_draft(&path));
        assert!(found.contains("line 6, column `z`"), "{text:?}: {found}");
    }
}

#[test]
fn a_row_has_a_cell_per_column_and_quotes_names() {
    let fields = [(VertexId::new(5), 0.75), (VertexId::new(9), 0.25)];
    let cell = Cell {
        level: LevelId::new(1),
        point: SurfacePoint { face: FaceId::new(3), barycentric: [0.25, 0.75, 0.0] },
        uv: DVec2::new(0.1, 1e-9),
        pixel: [12, 0],
        field: VertexId::new(5),
        taxel: TaxelId(u32::MAX),
        weights: fields.into_iter().collect(),
    };
    let (position, normal) = (DVec3::new(1.0, 0.5, 0.0), DVec3::Z);
    let place = LookupPlace {
        patch: "arm, \"left\"",
        link: "arm",
        region: Some("outer side"),
        cell,
        presence: Presence::ThermalPad,
        live_taxel: Some(TaxelId(8)),
        position,
        normal,
    };
    let row = LookupRow {
        contact: 7,
        level: LevelId::new(1),
        fields: None,
        distance: -0.001,
        frame: "world",
        place: Some(place),
        extra: &[],
    };
    for (names, extra) in [(None, &[][..]), (Some("least,most"), &[0.5, 0.75][..])] {
        let mut text = Vec::new();
        let mut table = LookupWriter::new(Path::new("-"), &mut text, names).unwrap();
        let row = LookupRow { extra, ..row };
        let off = LookupRow { contact: 8, distance: -0.0, place: None, ..row };
        table.write(2, |k, emit| emit([&row, &off][k])).unwrap();
        table.finish().unwrap();
        let more = |text| if names.is_some() { text } else { "" };
        let wanted = format!(
            "contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance,link,x,y,z,nx,ny,nz,fields,presence,live_taxel_id,region,frame{}\n\
             7,1,\"arm, \"\"left\"\"\",3,0.25,0.75,0.0,0.1,1e-9,12,0,5,4294967295,-0.001,arm,1.0,0.5,0.0,0.0,0.0,1.0,\
             5:0.75;9:0.25,thermal,8,outer side,world{}\n8,1,off skin,,,,,,,,,,,0.0,,,,,,,,,,,,world{}\n",
            more(",least,most"),
            more(",0.5,0.75"),
            more(",0.5,0.75"),
        );
        assert_eq!(String::from_utf8(text).unwrap(), wanted);
    }
}

/// A row on a level that is off the skin.
fn off_skin(contact: u64, level: usize) -> LookupRow<'static> {
    let level = LevelId::new(level);
    LookupRow { contact, level, fields: None, distance: 0.5, frame: "world", place: None, extra: &[] }
}

/// However many rows a contact has: all, in their order, each once.
#[test]
fn rows_of_long_and_short_contacts_come_in_order() {
    let rows_of = |contact: usize| if contact % 40 == 7 { 30_000 } else { contact % 3 };
    let mut text = Vec::new();
    let mut table = LookupWriter::new(Path::new("-"), &mut text, None).unwrap();
    for contacts in [3, 1, 500, 47] {
        table
            .write(contacts, |contact, emit| {
                (0..rows_of(contact)).for_each(|level| emit(&off_skin(contact as u64, level)));
            })
            .unwrap();
    }
    table.finish().unwrap();
    let text = String::from_utf8(text).unwrap();
    let found = text.lines().skip(1).map(|line| {
        let mut cells = line.split(',').map(|cell| cell.parse::<usize>().unwrap_or_default());
        (cells.next().unwrap(), cells.next().unwrap())
    });
    let expected = [3, 1, 500, 47].into_iter().flat_map(|contacts| {
        (0..contacts).flat_map(move |contact| (0..rows_of(contact)).map(move |level| (contact, level)))
    });
    assert!(found.eq(expected));
}

/// Some thousands of rows for each of a thousand contacts wait in a few megabytes.
#[test]
fn memory_does_not_grow_with_the_rows() {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let most = one.install(|| {
        let write = || {
            let mut table = LookupWriter::new(Path::new("-"), std::io::sink(), None).unwrap();
            table.write(3000, |contact, emit| emit(&off_skin(contact as u64, 0))).unwrap();
            table
                .write(1000, |contact, emit| {
                    (0..4000).for_each(|level| emit(&off_skin(contact as u64, level)))
                })
                .unwrap();
        };
        allocation_counter::measure(write).bytes_max
    });
    assert!(most < 40 << 20, "{most} bytes of 160 million");
}

#[test]
fn a_full_disk_is_an_error() {
    let mut nothing = [0; 10];
    let error = message(LookupWriter::new(Path::new("out.csv"), &mut nothing[..], None));
    assert!(error.contains("cannot write out.csv"), "{error}");
}

fn read_links(text: &str) -> Result<Motion, IoError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poses.csv");
    fs::write(&path, text).unwrap();
    let link = |name: &str| Link { name: name.into(), parent: None, pose: DAffine3::IDENTITY };
    let names = ["l0", "l1", "l2", "l3", "l4", "l5", "a", "arm", "twin", "twin"];
    Ok(read_motion(&path, None, &names.into_iter().map(link).collect())?.motion)
}

#[test]
fn a_quarter_turn_about_z_takes_x_to_y() {
    let poses = read_links("qw, qx, qy, qz, link, x, y, z\n0.70711, 0, 0, 0.70711, arm, 1, 2, 3\n").unwrap();
    let link = Link { name: "base".into(), parent: None, pose: DAffine3::IDENTITY };
    let mut map = SkinMap::flat(shapes::square(), 0.001);
    while map.links.len() < 8 {
        map.links.push(link.clone());
    }
    map.patches[PatchId::new(0)].link = LinkId::new(7);
    let mut index = ContactIndex::new(&map).unwrap();
    index.set_motion(&poses, 5.0).unwrap();
    let moved = index.poses()[LinkId::new(7)].transform_point3(DVec3::X);
    assert!(moved.distance(DVec3::new(1.0, 3.0, 3.0)) < 1e-12, "{moved}");
}

#[test]
fn a_table_of_poses_may_have_times() {
    let header = "time,link,x,y,z,qx,qy,qz,qw\n";
    let motion = read_links(&format!("{header}2,a,1,0,0,0,0,0,1\n-0.5,a,0,0,0,0,0,0,1\n")).unwrap();
    assert_eq!(motion.times(), Some([-0.5, 2.0]));
    for (rows, expected) in [
        ("0,a,0,0,0,0,0,0,1\n-0,a,0,0,0,0,0,0,1\n", "line 3, column `link`"),
        ("inf,a,0,0,0,0,0,0,1\n", "line 2, column `time`"),
    ] {
        let error = read_links(&format!("{header}{rows}")).unwrap_err().to_string();
        assert!(error.contains(expected), "{rows:?}: {error}");
    }
}

#[test]
fn invalid_poses_are_refused_with_their_line() {
    let header = "link,x,y,z,qx,qy,qz,qw\n";
    for (rows, expected) in [
        ("a,0,0,0,0,0,0,1\na,0,0,0,0,0,0,1\n", "line 3"),
        ("a,0,0,0,0,0,0,0.5\n", "length 1"),
        ("a,0,,0,0,0,0,1\n", "column `y`"),
        ("stranger,0,0,0,0,0,0,1\n", "line 2, column `link`: found \"stranger\""),
        (
            "twin,0,0,0,0,0,0,1\n",
            "line 2, column `link`: found \"twin\"; needed: a name of one link: 2 links",
        ),
        ("", "no row below the names of its columns"),
    ] {
        let error = read_links(&format!("{header}{rows}")).unwrap_err().to_string();
        assert!(error.contains(expected), "{rows:?}: {error}");
    }
    assert!(read_links("link,x,y,z\na,0,0,0\n").unwrap_err().to_string().contains("qx"));
    assert!(read_links("").is_err());
}

/// What is written is read back; empty cells are not known, and no column but the id is needed alone.
#[test]
fn responses_are_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("response.csv");
    let full = TaxelResponse {
        taxel: TaxelId(7),
        zero: Some(-3.5),
        gain: Some(-0.25),
        exponent: Some(0.85),
        drift: Some(1.25),
        sigma: Some(0.04),
        state: TaxelState::Swapped,
        other: Some(TaxelId(9)),
    };
    let taxels = vec![full, TaxelResponse::unknown(TaxelId(9))];
    let response = Response {
        unit: "count".into(),
        channel: "pdc".into(),
        scale: Some(Scale::Relative),
        method: "presses".into(),
        taxels,
    };
    write_response(path.as_path(), &response).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains("# scale: relative\n") && text.ends_with("9,,,,,,untested,\n"), "{text}");
    assert_eq!(read_response(&path).unwrap(), (response, vec![]));
    fs::write(&path, "id;gain;note\n1;2;x\n").unwrap();
    let (gains, unused) = read_response(&path).unwrap();
    assert_eq!((gains.taxels[0].gain, gains.taxels[0].zero, gains.scale), (Some(2.0), None, None));
    assert_eq!((gains.taxels[0].state, unused), (TaxelState::Untested, vec!["note".to_owned()]));
    assert!(!TaxelState::Ok.is_fault() && !TaxelState::Untested.is_fault());
    for (text, said) in [
        ("taxel_id,gain\n1,0\n", "not 0"),
        ("taxel_id,gain\n1,NaN\n", "a finite number"),
        ("taxel_id,gain\n1,2\n1,2\n", "each taxel once"),
        ("taxel_id,exponent\n1,-1\n", "a positive number"),
        ("taxel_id,sigma\n1,-1\n", "from 0 on"),
        ("taxel_id,state\n1,broken\n", "untested"),
        ("taxel_id,colour\n1,2\n", "one of zero"),
        ("gain\n1\n", "taxel_id"),
        ("# scale: kg\ntaxel_id,gain\n1,2\n", "relative or Pa"),
    ] {
        fs::write(&path, text).unwrap();
        let said_so = message(read_response(&path));
        assert!(said_so.contains(said), "{text}: {said_so}");
    }
}
