//! `sidehill play`: serves the page on which a simulation runs in the browser.

use crate::console;
use anyhow::{Context, Result, bail};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

/// Arguments of `sidehill play`.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct PlayArgs {
    /// Port on this machine's loopback; 0 takes a free one.
    #[arg(long, default_value_t = 0)]
    pub port: u16,
}

/// The page beside an installed program.
const INSTALLED: &str = "../share/sidehill/play/index.html";
/// What builds it, in a checkout, and what it then is.
const SCRIPT: &str = "bridge/play/build.sh";
const BUILT: &str = "target/play/index.html";
/// Longest wait for a request, and for a client to take the page.
const WAIT: Duration = Duration::from_secs(10);
/// Longest head of a request that is read, bytes.
const HEAD_MAX: u64 = 8192;
/// Clients that are served at the same time.
const CLIENTS_MAX: usize = 64;

/// Serves the page until an interrupt ends the program.
///
/// # Errors
/// Why there is no page, or why the port cannot be used.
pub fn run(args: &PlayArgs) -> Result<()> {
    let program = std::env::current_exe().context("this program's own file cannot be found")?;
    let page = page(&program)?;
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, args.port))
        .with_context(|| format!("--port {}: cannot listen on 127.0.0.1", args.port))?;
    let address = listener.local_addr()?;
    console::line(format_args!(
        "http://{address}/ until Ctrl+C: the simulation runs in the browser that opens it"
    ));
    serve(&listener, &Arc::from(page))
}

/// Returns the page of an installation, or that of the checkout in whose `target` the program is, built as its sources
/// are.
fn page(program: &Path) -> Result<Vec<u8>> {
    let installed = program.with_file_name(INSTALLED);
    if installed.is_file() {
        return read(&installed);
    }
    let Some(root) = checkout(program) else {
        bail!(
            "{}: the page is not installed beside this program, and the program is in no checkout that could build it. \
             In a checkout, `{SCRIPT}` writes {BUILT}, which any browser opens",
            installed.display()
        );
    };
    let script = root.join(SCRIPT);
    console::complain(format_args!(
        "builds the page with {SCRIPT}; the first time takes some minutes"
    ));
    let built = Command::new(&script)
        .status()
        .with_context(|| format!("{}", script.display()))?;
    if !built.success() {
        bail!("{SCRIPT}: {built}; its messages are above");
    }
    read(&root.join(BUILT))
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("{}", path.display()))
}

/// Returns the checkout in which a program was built.
fn checkout(program: &Path) -> Option<PathBuf> {
    let folders = program.ancestors();
    let mut roots = folders.filter(|folder| folder.join(SCRIPT).is_file());
    roots.next().map(Path::to_owned)
}

/// Gives the page to everyone who asks, each in a thread of its own: browsers open connections that they do not use.
fn serve(listener: &TcpListener, page: &Arc<[u8]>) -> Result<()> {
    let clients = Arc::new(());
    for client in listener.incoming() {
        let Ok(client) = client else { continue };
        if Arc::strong_count(&clients) > CLIENTS_MAX {
            continue;
        }
        let (page, place) = (page.clone(), clients.clone());
        let thread = std::thread::Builder::new().name("play".to_owned());
        thread.spawn(move || {
            // An error of a client ends this client only.
            let _ = answer(client, &page);
            drop(place);
        })?;
    }
    Ok(())
}

/// Answers the request of a client: there is only the page.
fn answer(mut client: TcpStream, page: &[u8]) -> std::io::Result<()> {
    client.set_read_timeout(Some(WAIT))?;
    client.set_write_timeout(Some(WAIT))?;
    let mut head = Vec::new();
    let mut bytes = [0; 1024];
    while !head.windows(4).any(|end| end == b"\r\n\r\n") && (head.len() as u64) < HEAD_MAX {
        match client.read(&mut bytes)? {
            0 => return Ok(()),
            count => head.extend(&bytes[..count]),
        }
    }
    let line = head.split(|byte| *byte == b'\r').next().unwrap_or_default();
    let mut words = line.split(|byte| *byte == b' ');
    let (method, target) = (words.next().unwrap_or_default(), words.next());
    let path = target.and_then(|target| target.split(|byte| *byte == b'?').next());
    let (status, body, kind) = match path {
        Some(b"/" | b"/index.html") if method == b"GET" || method == b"HEAD" => {
            ("200 OK", page, "text/html")
        }
        _ => (
            "404 Not Found",
            b"There is only the page at /.\n".as_slice(),
            "text/plain",
        ),
    };
    // The page may load nothing, speak to no server, and be in no other page.
    let policy = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; \
                  img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
    write!(
        client,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}; charset=utf-8\r\nContent-Length: {}\r\n\
         Content-Security-Policy: {policy}\r\nReferrer-Policy: no-referrer\r\n\
         X-Content-Type-Options: nosniff\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n",
        body.len()
    )?;
    if method != b"HEAD" {
        client.write_all(body)?;
    }
    client.shutdown(std::net::Shutdown::Write)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Serves a page and returns a function that asks for something.
    fn server() -> impl Fn(&str) -> String {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || serve(&listener, &Arc::from(b"<p>page".as_slice())));
        move |request| {
            let mut client = TcpStream::connect(address).unwrap();
            client.write_all(request.as_bytes()).unwrap();
            let mut answer = String::new();
            client.read_to_string(&mut answer).unwrap();
            answer
        }
    }

    #[test]
    fn there_is_only_the_page() {
        let ask = server();
        for path in ["/", "/?a=b", "/index.html"] {
            let answer = ask(&format!("GET {path} HTTP/1.1\r\nHost: a\r\n\r\n"));
            assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
            assert!(answer.ends_with("\r\n\r\n<p>page"), "{answer}");
        }
        let head = ask("HEAD / HTTP/1.1\r\n\r\n");
        assert!(head.starts_with("HTTP/1.1 200 ") && head.ends_with("\r\n\r\n"));
        for request in [
            "GET /etc/passwd HTTP/1.1\r\n\r\n",
            "GET /../a HTTP/1.1\r\n\r\n",
            "POST / HTTP/1.1\r\n\r\n",
            "\r\n\r\n",
        ] {
            let answer = ask(request);
            assert!(answer.starts_with("HTTP/1.1 404 "), "{request:?}: {answer}");
        }
    }

    #[test]
    fn a_client_that_asks_for_nothing_keeps_no_other_waiting() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || serve(&listener, &Arc::from(b"page".as_slice())));
        let silent = TcpStream::connect(address).unwrap();
        let mut client = TcpStream::connect(address).unwrap();
        client.set_read_timeout(Some(WAIT / 2)).unwrap();
        client.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
        let mut answer = String::new();
        client.read_to_string(&mut answer).unwrap();
        assert!(answer.ends_with("page"), "{answer}");
        drop(silent);
    }

    #[test]
    fn the_page_of_an_installation_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let (program, share) = (
            folder.path().join("bin/sidehill"),
            folder.path().join("share/sidehill/play"),
        );
        std::fs::create_dir_all(folder.path().join("bin")).unwrap();
        let error = page(&program).unwrap_err().to_string();
        assert!(error.contains(SCRIPT), "{error}");
        std::fs::create_dir_all(&share).unwrap();
        std::fs::write(share.join("index.html"), "page").unwrap();
        assert_eq!(page(&program).unwrap(), b"page");
    }

    #[test]
    fn the_page_of_a_checkout_is_the_one_that_its_script_builds() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("target/debug/sidehill");
        let script = folder.path().join(SCRIPT);
        std::fs::create_dir_all(script.parent().unwrap()).unwrap();
        std::fs::create_dir_all(folder.path().join("target/play")).unwrap();
        let write = |text: &str| {
            std::fs::write(&script, text).unwrap();
            std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
        };
        write("#!/bin/sh\nprintf built >\"$(dirname \"$0\")/../../target/play/index.html\"\n");
        assert_eq!(page(&program).unwrap(), b"built");
        write("#!/bin/sh\nexit 3\n");
        let error = page(&program).unwrap_err().to_string();
        assert!(error.contains("exit status: 3"), "{error}");
    }
}
