//! A service that renders on request: `cargo run --release -p carom-farm --example service -- [ADDRESS]`, then
//! `curl 'http://127.0.0.1:8080/?x=0.3&samples=64' -o ball.png`

use std::sync::{Arc, Mutex, PoisonError};

use axum::extract::{Query, State};
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use axum::{Router, routing};
use carom_farm::prelude::*;
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Request {
    x: f32,
    samples: u32,
}

impl Default for Request {
    fn default() -> Self {
        Self {
            x: 0.0,
            samples: 16,
        }
    }
}

/// Renders concurrently with other requests: the farm is locked only while a job is submitted.
fn render(farm: &Mutex<Farm>, request: &Request) -> carom_farm::Result<Vec<u8>> {
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.0, 2.0], [0.0, 0.0, 0.5]));
    let ball = Sphere::new(0.5).at([request.x, 0.0, 0.5]);
    scene.add_named("ball", ball, Material::diffuse([0.8, 0.1, 0.1]));
    scene.add(Plane::z(0.0), Material::grey(0.5));
    let still = Still::new(320, 180).samples(request.samples);
    let job = farm
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .still(&scene, still)?;
    job.wait()?.png()
}

async fn answer(
    State(farm): State<Arc<Mutex<Farm>>>,
    Query(request): Query<Request>,
) -> impl IntoResponse {
    match tokio::task::spawn_blocking(move || render(&farm, &request)).await {
        Ok(Ok(png)) => Ok(([(header::CONTENT_TYPE, "image/png")], png)),
        Ok(Err(why)) if why.is_invalid_input() => Err((StatusCode::BAD_REQUEST, why.to_string())),
        Ok(Err(why)) => Err((StatusCode::SERVICE_UNAVAILABLE, why.to_string())),
        Err(panic) => Err((StatusCode::INTERNAL_SERVER_ERROR, panic.to_string())),
    }
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let address = std::env::args().nth(1);
    let address = address.unwrap_or_else(|| "127.0.0.1:8080".to_owned());
    let farm = Arc::new(Mutex::new(Farm::auto()?));
    let listener = tokio::net::TcpListener::bind(address).await?;
    println!("http://{}/?x=0.3&samples=64", listener.local_addr()?);
    let service = Router::new()
        .route("/", routing::get(answer))
        .with_state(farm);
    Ok(axum::serve(listener, service).await?)
}
