//! Any file of 2 MB is read or refused in less than a second of the processor's time.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::path::Path;

use gaitfit_model::{Model, ModelError, ReadOptions, Root, read, read_mjcf_str, read_urdf_str};
use rustix::time::{ClockId, clock_gettime};

const SIZE: usize = 2_000_000;

/// Processor time of this thread, s: what other programs do does not count.
fn processor_seconds() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
}

/// Reads strictly and leniently; the message of the strict reading, empty where it succeeds.
fn timed(what: &str, read: impl Fn(&ReadOptions) -> Result<Model, ModelError>) -> String {
    let mut message = String::new();
    for lenient in [true, false] {
        let start = processor_seconds();
        let result = read(&ReadOptions { lenient, add_floor: true, ..Default::default() });
        let seconds = processor_seconds() - start;
        eprintln!("{what}: {seconds:.3}");
        assert!(seconds < 1.0, "{what}: {seconds} s");
        message = result.err().map(|error| error.to_string()).unwrap_or_default();
        assert!(message.len() < 2000, "{what}: {message}");
    }
    message
}

/// `piece` for 0, 1, …, as often as fits into `size` bytes; `#` stands for the number.
fn fill(size: usize, piece: &str) -> String {
    let mut all = String::new();
    for index in 0.. {
        all.push_str(&piece.replace('#', &index.to_string()));
        if all.len() >= size {
            break;
        }
    }
    all
}

fn repeat(count: usize, piece: &str) -> String {
    (0..count).map(|index| piece.replace('#', &index.to_string())).collect()
}

/// A robot of one hinge, with something in places where anything may stand.
fn mjcf(ignored: &str, in_body: &str, sections: &str) -> String {
    format!(
        "<mujoco><visual>{ignored}</visual><worldbody><geom type='plane' name='floor'/><body name='base'><freejoint/>\
         <geom size='.1'/>{in_body}<body name='leg'><joint name='knee'/><geom size='.1'/></body></body></worldbody>\
         {sections}</mujoco>"
    )
}

fn urdf(ignored: &str, links: &str) -> String {
    let mass =
        "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>";
    format!(
        "<robot name='r'><material>{ignored}</material><link name='base'>{mass}</link><link name='leg'>{mass}</link>\
         <joint name='knee' type='continuous'><parent link='base'/><child link='leg'/></joint>{links}</robot>"
    )
}

/// XML alone, inside of elements that both formats pass over.
#[test]
fn hostile_xml_takes_no_time() {
    let nested = |piece: &str, count: usize| format!("{}{}", repeat(count, piece), "</a>".repeat(count));
    let crowded = |form: &str| format!("<a {}/>", repeat(90, form));
    let prefixes = format!("<a {}>", repeat(90, "xmlns:n#='u#' "));
    for (what, junk, refused) in [
        ("namespaces of a tag", format!("<a {}/>", fill(SIZE, "xmlns:n#='u#' ")), "attributes"),
        ("namespaces of sons", fill(SIZE, "<a xmlns:n#='u'/>"), "namespace declarations"),
        ("default namespaces", fill(SIZE, "<a xmlns='#'/>"), "namespace declarations"),
        ("nested namespaces", nested("<a xmlns:n# = 'u' xmlns:m# = 'u'>", 90), "namespace declarations"),
        ("prefixes", format!("{prefixes}{}</a>", fill(SIZE, "<n89:a n88:b='' n87:b='' n86:b=''/>")), ""),
        ("unknown prefixes", format!("{prefixes}{}</a>", fill(SIZE, "<n8:a n9:b='' n90:b=''/>")), "any"),
        ("attributes", format!("<a {}/>", fill(SIZE, "a#=\"1\" ")), "attributes"),
        ("attributes with a space", format!("<a {}/>", fill(SIZE, "a#= \"1\" ")), "attributes"),
        ("attributes with a space before", format!("<a {}/>", fill(SIZE, "a# =\"1\" ")), "attributes"),
        ("crowded tags", fill(SIZE, &crowded("a#='' ")), ""),
        ("crowded tags, long names", fill(SIZE, &crowded(&format!("{}#='' ", "a".repeat(250)))), ""),
        ("name of a tag", format!("<{0}></{0}>", "n".repeat(SIZE / 2)), "a name of more than 256 bytes"),
        ("name of an attribute", format!("<a {}='1'/>", "n".repeat(SIZE)), "a name of more than 256 bytes"),
        ("deep", nested("<a>", SIZE / 7), "deeper"),
        ("deep and open", "<a>".repeat(SIZE / 3), "deeper"),
        ("many", "<a/>".repeat(SIZE / 4), "nodes"),
        ("texts", "<a/>x".repeat(199_000), ""),
        ("character data", "a<![CDATA[b]]>".repeat(SIZE / 14), ""),
        ("comments", "x<!---->".repeat(195_000), ""),
        ("comments without end", "<!--".repeat(SIZE / 4), "any"),
        ("instructions", "<?a?>x".repeat(195_000), ""),
        ("entities", "&lt;".repeat(SIZE / 4), ""),
        ("numbers of characters", "&#65;\r".repeat(SIZE / 6), ""),
        ("entities of values", format!("<a b='{}'/>", "&#10;&amp;".repeat(SIZE / 10)), ""),
        ("unknown entities", format!("<a b='{}'/>", "&lol;".repeat(SIZE / 5)), "any"),
        ("quotes", format!("<a b={}", "'\"".repeat(SIZE / 2)), "any"),
        ("brackets", "<".repeat(SIZE), "any"),
        ("closing tags", "</a>".repeat(SIZE / 4), "any"),
    ] {
        let files = [
            timed(what, |options| read_mjcf_str(&mjcf(&junk, "", ""), options)),
            timed(what, |options| read_urdf_str(&urdf(&junk, ""), options)),
        ];
        for message in files {
            let right = match refused {
                "" => message.is_empty(),
                "any" => !message.is_empty(),
                part => message.contains(part) && message.starts_with("<text>:1:"),
            };
            assert!(right, "{what}: {message}");
        }
    }
}

#[test]
fn hostile_mjcf_takes_no_time() {
    // Names of the same length that differ at their ends only.
    let name = |index: &str| format!("{}{index}", "n".repeat(200));
    let geoms = repeat(2000, &format!("<geom name='{}' size='.1' contype='1'/>", name("1#")));
    let pair = format!("<pair geom1='{}' geom2='floor'/>", name("11999"));
    let exclude = "<exclude body1='base' body2='leg'/>";
    let chain = |count: usize| {
        format!(
            "{}{}",
            repeat(count, "<body><joint/><joint axis='1 0 0'/><geom size='.1'/>"),
            "</body>".repeat(count)
        )
    };
    let servos = repeat(2000, "<position joint='knee' kp='1' dampratio='1'/>");
    let class = |entries: &str| {
        format!("<default>{}</default>", repeat(500, &format!("<default class='c#'>{entries}</default>")))
    };
    let bodies = repeat(250, "<body name='b#'><geom size='.1'/><joint/></body>");
    for (what, text, refused) in [
        ("geoms", mjcf("", &geoms, ""), ""),
        ("geoms and pairs", mjcf("", &geoms, &format!("<contact>{}</contact>", pair.repeat(2000))), ""),
        ("geoms and excludes", mjcf("", &geoms, &format!("<contact>{}</contact>", exclude.repeat(2000))), ""),
        ("geoms without end", mjcf("", &fill(SIZE, "<geom size='1'/>"), ""), "more than 2048 geoms"),
        (
            "planes",
            mjcf("", &geoms, &format!("<worldbody>{}</worldbody>", "<geom type='plane'/>".repeat(40))),
            "pairs",
        ),
        ("chain", mjcf("", &chain(95), ""), ""),
        ("bodies", mjcf("", &bodies, ""), ""),
        ("joints", mjcf("", &fill(SIZE, "<body><geom size='1'/><joint/></body>"), ""), "any"),
        ("servos", mjcf("", &bodies, &format!("<actuator>{servos}</actuator>")), ""),
        ("servos of a chain", mjcf("", &chain(95), &format!("<actuator>{servos}</actuator>")), ""),
        ("classes", mjcf("", "", &class(&"<geom size='1'/><joint damping='1'/>".repeat(100))), ""),
        (
            "classes without end",
            mjcf("", "", &format!("<default>{}</default>", fill(SIZE, "<default class='c#'/>"))),
            "classes",
        ),
        ("sites", mjcf("", &repeat(2000, &format!("<site name='{}'/>", name("1#"))), ""), ""),
        ("keyframes", mjcf("", "", &format!("<keyframe>{}</keyframe>", "<key/>".repeat(2048))), ""),
        (
            "a long keyframe",
            mjcf("", "", &format!("<keyframe><key qpos='{}'/></keyframe>", "0 ".repeat(SIZE / 2))),
            "numbers",
        ),
        ("a long number", mjcf("", "", &format!("<option timestep='0.{}'/>", "1".repeat(SIZE))), ""),
        (
            "a long word",
            mjcf("", "", &format!("<option integrator='{}'/>", "E".repeat(SIZE))),
            "one of Euler",
        ),
        ("a long name", mjcf("", &format!("<site name='{}'/>", "s".repeat(SIZE)), ""), "2000000 bytes"),
        ("a long class", mjcf("", &format!("<site class='{}'/>", "s".repeat(SIZE)), ""), "does not exist"),
        (
            "speed limits",
            mjcf(
                "",
                &bodies,
                &format!(
                    "<custom><tuple name='velocity_limit'>{}</tuple></custom>",
                    "<element objtype='joint' objname='knee' prm='1'/>".repeat(SIZE / 50)
                ),
            ),
            "",
        ),
        (
            "made-up names",
            mjcf(
                "",
                &format!(
                    "{}<site/>",
                    (0..1400)
                        .map(|n| format!("<site name='site1400{}'/>", "_".repeat(n % 240)))
                        .collect::<String>()
                ),
                "",
            ),
            "twice",
        ),
        ("unknown sections", mjcf("", "", &fill(SIZE, "<x#/>")), "any"),
        ("unknown attributes", mjcf("", &fill(SIZE, "<site a#='1'/>"), ""), "any"),
        ("includes", mjcf("", "", &fill(SIZE, "<include file='a'/>")), "any"),
    ] {
        let message = timed(what, |options| read_mjcf_str(&text, options));
        let right = match refused {
            "" => message.is_empty(),
            "any" => !message.is_empty(),
            part => message.contains(part),
        };
        assert!(right, "{what}: {message}");
    }
}

#[test]
fn hostile_urdf_takes_no_time() {
    let mass =
        "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>";
    let ball = "<collision><geometry><sphere radius='.1'/></geometry></collision>";
    let star = repeat(
        250,
        &format!(
            "<link name='l#'>{mass}{}</link><joint name='j#' type='continuous'><parent link='base'/><child link='l#'/></joint>",
            ball.repeat(8)
        ),
    );
    for (what, text, refused) in [
        ("links", urdf("", &star), ""),
        ("links without end", urdf("", &fill(SIZE, "<link name='l#'/>")), "more than 256 links"),
        (
            "joints without end",
            urdf(
                "",
                &fill(SIZE, "<joint name='j#' type='fixed'><parent link='base'/><child link='leg'/></joint>"),
            ),
            "child of two",
        ),
        ("extensions", urdf("", &fill(SIZE, "<gazebo a#='1'/>")), ""),
        ("a long name", urdf("", &format!("<link name='{}'/>", "l".repeat(SIZE))), "any"),
        (
            "collisions",
            urdf("", &format!("<link name='x'>{}</link>", fill(SIZE, ball))),
            "collisions of a link",
        ),
        ("unknown", urdf("", &fill(SIZE, "<x#/>")), "any"),
    ] {
        let message = timed(what, |options| read_urdf_str(&text, options));
        let right = match refused {
            "" => message.is_empty(),
            "any" => !message.is_empty(),
            part => message.contains(part),
        };
        assert!(right, "{what}: {message}");
    }
}

#[test]
fn hostile_includes_take_no_time() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    let namespaces = format!("<a {}/>", repeat(90, "xmlns:n#='u#' "));
    for index in 0..60 {
        write(
            &format!("{index}.xml"),
            format!("<m>{}{namespaces}</m>", fill(SIZE / 60 - 2000, "<a b='1'/>")),
        );
    }
    let all = format!("<mujoco><visual>{}</visual></mujoco>", repeat(60, "<include file='#.xml'/>"));
    write("all.xml", all);
    let path: &Path = &folder.path().join("all.xml");
    let message = timed("includes", |options| read(path, options));
    assert!(message.contains("200000 XML nodes") || message.contains("can move"), "{message}");
    // The nodes of all files count together.
    for index in 0..3 {
        write(&format!("{index}.xml"), format!("<m>{}</m>", "<a/>".repeat(80_000)));
    }
    let message = timed("nodes", |options| read(path, options));
    assert!(message.contains("2.xml:1:") && message.contains("200000 XML nodes"), "{message}");
    let fixed = ReadOptions { lenient: true, root: Some(Root::Fixed), ..Default::default() };
    assert!(read(path, &fixed).is_err());
}
