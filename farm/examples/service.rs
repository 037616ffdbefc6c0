//! A service that renders on request: `cargo run --release -p carom-farm --example service -- [ADDRESS] [REQUESTS]`,
//! then `curl 'http://127.0.0.1:8080/?x=0.3&samples=64' -o ball.png`. With REQUESTS it ends after so many.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use carom_farm::prelude::*;

/// The value of a parameter of the request's first line, `GET /?x=0.3&samples=64 HTTP/1.1`.
fn parameter<T: std::str::FromStr>(line: &str, name: &str) -> Option<T> {
    let query = line.split_whitespace().nth(1)?.split_once('?')?.1;
    let value = |pair: &str| Some(pair.strip_prefix(name)?.strip_prefix('=')?.to_owned());
    query.split('&').find_map(value)?.parse().ok()
}

fn render(farm: &mut Farm, line: &str) -> carom_farm::Result<Vec<u8>> {
    let (x, samples) = (parameter(line, "x"), parameter(line, "samples"));
    let mut scene = Scene::new();
    let ball = Sphere::new(0.5).at([x.unwrap_or(0.0), 0.0, 0.5]);
    scene.add_named("ball", ball, Material::diffuse([0.8, 0.1, 0.1]));
    scene.add(Plane::z(0.0), Material::grey(0.5));
    let picture = farm.render(&scene, Still::new(320, 180).samples(samples.unwrap_or(16)))?;
    picture.png()
}

/// Answers a request: a picture, or a sentence.
fn answer(farm: &mut Farm, mut stream: TcpStream) -> std::io::Result<()> {
    stream.set_read_timeout(Some(Duration::from_secs(5)))?;
    let mut line = String::new();
    BufReader::new(&stream).read_line(&mut line)?;
    let (status, kind, body) = match render(farm, &line) {
        Ok(png) => ("200 OK", "image/png", png),
        Err(why) => (
            "400 Bad Request",
            "text/plain",
            format!("{why}\n").into_bytes(),
        ),
    };
    let length = body.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    )?;
    stream.write_all(&body)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let address = arguments
        .next()
        .unwrap_or_else(|| "127.0.0.1:8080".to_owned());
    let requests = arguments
        .next()
        .map_or(Ok(usize::MAX), |count| count.parse())?;
    let mut farm = Farm::auto()?;
    let listener = TcpListener::bind(address)?;
    println!("http://{}/?x=0.3&samples=64", listener.local_addr()?);
    for stream in listener.incoming().take(requests) {
        if let Err(why) = answer(&mut farm, stream?) {
            eprintln!("a request failed: {why}");
        }
    }
    Ok(())
}
