# docker build -t casp-drift . && docker run --rm -v "$PWD:/work" --user "$(id -u):$(id -g)" casp-drift run overdue_boat
FROM python:3.13-slim AS build
WORKDIR /src
RUN python -m venv /opt/drift && /opt/drift/bin/pip install --no-cache-dir --upgrade pip
COPY pyproject.toml README.md LICENSE ./
COPY drift drift
COPY geo geo
COPY kernels kernels
COPY cases cases
RUN /opt/drift/bin/pip install --no-cache-dir '.[serve]'
# Compiles the kernels of a forecast and reads the coast once, so that containers begin at once.
ENV XDG_CACHE_HOME=/opt/cache TI_OFFLINE_CACHE_FILE_PATH=/opt/cache/taichi
RUN /opt/drift/bin/drift new position /tmp/case.toml \
    && /opt/drift/bin/drift run /tmp/case.toml --set particles=1000 --out /tmp/results --quiet \
    && chmod -R a+rwX /opt/cache

FROM python:3.13-slim
RUN useradd --create-home drift && mkdir /work && chown drift /work
COPY --from=build /opt /opt
ENV PATH=/opt/drift/bin:$PATH XDG_CACHE_HOME=/opt/cache TI_OFFLINE_CACHE_FILE_PATH=/opt/cache/taichi
USER drift
WORKDIR /work
ENTRYPOINT ["drift"]
CMD ["--help"]
